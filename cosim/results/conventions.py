"""Axes and components of what is written."""

from __future__ import annotations

import numpy as np

IN_METACARPAL = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""World (distal, radial, dorsal) to (distal, palmar, radial)."""
COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
AXES = ("distal", "radial", "dorsal")
"""The world's x, y, z; palmar is minus dorsal."""
