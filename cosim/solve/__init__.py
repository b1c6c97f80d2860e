"""Solvers of a case: one way, in motion, and with a finger in an FMU."""
