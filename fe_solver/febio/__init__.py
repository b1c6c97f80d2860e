"""FEBio's files, read, written and compared with."""
