"""Fingers on MuJoCo, at rest and in motion."""
