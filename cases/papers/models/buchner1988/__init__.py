"""Buchner et al. 1988: coordination of the joints."""
