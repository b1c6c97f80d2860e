"""Muscles' tensions from what a finger is asked for."""
