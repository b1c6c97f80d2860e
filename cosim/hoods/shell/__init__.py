"""The hood of shell elements: its table, how it is built, what it looks like solved."""
