"""Packaged cases: one TOML file for each run, in SI-checked quantities with units."""
