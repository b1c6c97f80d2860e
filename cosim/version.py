"""The version of cosim-hand, which stands here alone."""

__version__ = "0.1.0"
