"""Hoods behind the port, of shells and of cables."""
