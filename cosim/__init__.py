"""Co-simulation of a finger's extensor hood and its bones: a case in, an audited answer out."""

__version__ = "0.1.0"
