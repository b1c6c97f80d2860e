"""Parameters fitted to measured numbers, and what the results depend on."""
