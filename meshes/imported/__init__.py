"""A user's hood mesh: read, named, checked."""
