"""Analyses that solve a case many times."""
