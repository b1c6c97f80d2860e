"""Tests, in the rooms of the packages; what is no test is in tests/helpers."""
