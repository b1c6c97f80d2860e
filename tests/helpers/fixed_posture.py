"""A case that studies solve many times: bones held at 30/45/15 deg, the PIP with a spring."""

HELD = """
extends = "split_edc"
[finger.tip]
kind = "posture"
[finger.passive.PIP]
stiffness = "0.04 N*m/rad"
rest = "0 deg"
"""
