"""Forces on a model besides its elements: cables, contact, guides, loads, springs."""
