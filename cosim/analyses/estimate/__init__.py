"""Muscle tensions from a fingertip force, joint torques or a motion."""
