"""A network hood fitted to what a shell or a net of cables does."""
