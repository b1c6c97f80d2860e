"""Positions (2, 3) m and rotations (2, 3, 3) of two bodies, askew."""

from __future__ import annotations

import numpy as np

from cosim.port import rotation_matrix

POSITION = np.array([[1e-3, -2e-3, 0.5e-3], [-3e-3, 0.0, 1e-3]])
ROTATION = rotation_matrix(np.array([[0.3, -0.2, 0.5], [-0.6, 0.1, 0.2]]))
