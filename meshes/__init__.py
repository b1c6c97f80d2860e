"""Measured geometry of the finger: its skeleton, its bones and the hoods that lie over them."""
