"""Rigid fingers and hoods without a deformable degree of freedom (SI units, world frame)."""
