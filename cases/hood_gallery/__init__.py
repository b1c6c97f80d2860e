"""A hood over many postures."""
