"""The hoods in lumped form: their tables, and how they are built."""
