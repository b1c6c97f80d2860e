"""Hoods without finite elements: pulleys, bands, networks."""
