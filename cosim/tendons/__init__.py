"""Tendons: their tables, their tensions over time, and the muscles and cylinders that pull them."""
