"""The frame of everything that is written, and its axes by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from cosim.port import AXES, Array, Hand
from cosim.version import __version__

OPPOSITE = {"proximal": "distal", "ulnar": "radial", "palmar": "dorsal"}
"""The name of each axis's other way: the palmar component is minus the dorsal one."""
FRAME = "world, fixed to the metacarpal: x distal, y radial, z dorsal; right-handed"
LEFT_FRAME = "world of a left hand, fixed to the metacarpal: x distal, y ulnar, z dorsal"
BY_DIRECTION: dict[Hand, str] = {
    "right": FRAME,
    "left": "world of a left hand, fixed to the metacarpal: x distal, y radial, z dorsal; "
    "left-handed, moments by the left hand's rule",
}
"""The frame of what is said by direction: of a left hand the mirror image of its own."""
COMPONENTS = tuple(f"{kind}_{axis}" for kind in ("force", "moment") for axis in AXES)
"""The components of a wrench, in the order of the port."""
SOURCES = {
    "joint": "joint contact",
    "passive": "passive joint stiffness",
    "limit": "limits and splints of the joints",
    "tie": "ties from bone to bone",
    "fingertip": "support of the fingertip",
    "ground": "support of the metacarpal",
    "hood contact": "contact with the hood",
    "hood linearisation": "linearisation of the hood",
}
"""Sources of the ledger whose names alone do not say what they are."""
SLACK = 0.05
"""Share of both slips' force together that a slack slip bears at most."""


def by_name(names: Iterable[str], values: Iterable[float]) -> dict[str, float]:
    """Values by their names, of which there are as many."""
    return dict(zip(names, map(float, values), strict=True))


def by_axis(vector: Iterable[float]) -> dict[str, float]:
    """The components of a vector (3,) in the world, by the name of the axis."""
    return by_name(AXES, vector)


def attributes(title: str, case: str, hand: Hand) -> dict[str, str]:
    """What a file of arrays says of itself (CF conventions 1.11, and the frame)."""
    return {
        "Conventions": "CF-1.11",
        "title": title,
        "source": f"cosim {__version__}, case {case}",
        "case": case,
        "version": __version__,
        "frame": BY_DIRECTION[hand],
    }


def vector_of(components: Mapping[str, float]) -> Array:
    """The vector (3,) whose components are named: the inverse of `by_axis`."""
    return np.array([components[axis] for axis in AXES], dtype=float)


def is_slack(slips: Mapping[str, float], slip: str) -> bool:
    """Whether a slip bears so little of both slips' force (N) that no quotient by it says
    anything."""
    return slips[slip] <= SLACK * sum(slips.values())


def joint_words(joint: str) -> str:
    """Return a degree of freedom in words: of a joint that abducts too, flexion is the plain name.

    >>> joint_words("MCP"), joint_words("MCP_abduction")
    ('MCP flexion', 'MCP abduction')
    """
    words = joint.replace("_", " ")
    return words if words.endswith("abduction") else f"{words} flexion"


def source_words(source: str) -> str:
    """Return a source of the ledger in words.

    >>> source_words("hood central_slip"), source_words("joint"), source_words("FDP")
    ('central slip (hood)', 'joint contact', 'FDP')
    """
    if source in SOURCES:
        return SOURCES[source]
    name = source.removeprefix("hood ").replace("_", " ")
    return f"{name} (hood)" if source.startswith("hood ") else name
