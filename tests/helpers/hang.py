"""How long a test waits for what must come: no verdict by the clock on a slow machine."""

HANG = 300.0
"""s that only what hangs reaches; what is to be cut short lasts twice as long."""
