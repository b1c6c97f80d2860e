"""The hood of cables: its table, and how it is built."""
