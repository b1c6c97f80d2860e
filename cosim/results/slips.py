"""Numbers that follow from the forces in the slips."""

from __future__ import annotations

from collections.abc import Mapping

SLACK = 0.05
"""Share of both slips' force together that a slack slip bears at most."""


def is_slack(slips: Mapping[str, float], slip: str) -> bool:
    """Whether a slip bears so little of both slips' force (N) that no quotient by it says
    anything."""
    return slips[slip] <= SLACK * sum(slips.values())
