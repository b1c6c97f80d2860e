"""The verification of the shell solver: closed forms, published benchmarks and FEBio's figures."""
