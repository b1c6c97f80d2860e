"""Pneumatic cylinders and their valves."""
