"""Rigid surfaces: distance, normal and curvature."""
