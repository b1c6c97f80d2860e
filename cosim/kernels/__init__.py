"""Small loops compiled by numba, and where the compiled ones are kept."""
