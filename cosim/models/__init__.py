"""Live models of a case."""
