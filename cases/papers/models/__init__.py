"""Models of published work, for the scripts beside them and for proofs."""
