"""Packaged cases, a folder a family: one TOML file for each run, found by its name alone."""
