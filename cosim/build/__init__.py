"""From a case to live models."""
