"""Shell elements: kinds, strains, stiffness."""
