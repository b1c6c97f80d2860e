"""The case: its schema, its file, and its faults in plain words."""
