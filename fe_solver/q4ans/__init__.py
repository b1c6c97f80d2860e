"""FEBio's shell and contact, made from its documentation: its files are solved with them."""
