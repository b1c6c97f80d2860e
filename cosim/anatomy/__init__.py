"""A user's own anatomy, read, checked and made a case."""
