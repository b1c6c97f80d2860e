"""Co-simulation of a finger's extensor hood and its bones: a case in, an audited answer out."""

from cosim.version import __version__

__all__ = ["__version__"]
