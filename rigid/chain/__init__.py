"""Fingers as chains of bones in closed form."""
