"""FEBio's own shell and contact, made from its documentation, to compare ours with."""
