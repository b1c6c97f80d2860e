"""A nonlinear shell finite-element solver, usable alone."""
