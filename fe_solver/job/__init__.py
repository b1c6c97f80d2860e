"""Stand-alone shell models: read, checked, solved, written."""
