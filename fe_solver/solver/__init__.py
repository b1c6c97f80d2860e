"""The model, its assembly, Newton's method and dynamics."""
