"""A case solved many times with other settings."""
