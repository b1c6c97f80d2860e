"""The version of cosim-hand, and of the FMUs that it writes; both stand here alone."""

__version__ = "0.1.0"
FMU_FORMAT = 3
"""Number of the layout of a written FMU.  It rises with each change of what a unit's archive holds
or asks of the program (`tests/fmu/test_fmu_format.py` says when)."""
