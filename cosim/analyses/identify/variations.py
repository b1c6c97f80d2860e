"""What the sensitivity study varies: pairs of settings of what a case has, each with its reason.

Ranges are those of the literature where there are any, else assumptions: moduli and joint stiffness
+-50 %, cross-sections 0.3 to 1.8 mm2 (what network models of the hood take for its parts: Dogadov
et al., arXiv:2507.15389), rest lengths +-0.2 mm, contact offsets +-0.3 mm, postures +-5 deg, meshes
of 2 and 4 times the quads; bending, springs, limits, friction and fibres by factors of 2, slack by
1 mm.  A hood that slides without friction gets a coefficient of 0.1 and of 0.3.
"""

from __future__ import annotations

from collections.abc import Iterator

from cosim.case.schema import Case
from cosim.hoods.kinds import KINDS
from cosim.hoods.variation import Variation, no_variation, scale, shift
from cosim.schema import units


def variations(case: Case) -> tuple[Variation, ...]:
    """All that this study varies, in a fixed order; what does not apply to the case says why."""
    return (*KINDS[case.hood.kind].variations(case.hood), *_finger_variations(case))


def _finger_variations(case: Case) -> Iterator[Variation]:
    if not case.finger.is_native:
        yield no_variation("posture", "the finger is an FMU, which holds its posture")
        return
    finger = case.native_finger()
    held = "the bones are held" if finger.tip.kind == "posture" else ""
    stiff = {
        f"finger.passive.{joint}.stiffness": p.stiffness
        for joint, p in finger.passive.items()
        if p.stiffness
    }
    limit = finger.limit
    if held or not stiff:
        yield no_variation("joint stiffness", held or "no joint has a linear stiffness")
    else:
        yield scale("joint stiffness", stiff, (0.5, 1.5), units.JOINT_STIFFNESS)
    if held or limit is None:
        yield no_variation("limit law", held or "the finger has no limit")
    else:
        free, stiffness = limit.half_range, limit.stiffness
        key = "finger.limit"
        yield scale("limit's half range", {f"{key}.half_range": free}, (0.5, 2.0), units.ANGLE)
        slope = {f"{key}.stiffness": stiffness}
        yield scale("limit's stiffness", slope, (0.5, 2.0), units.LIMIT_STIFFNESS)
    for joint in ("MCP", "PIP", "DIP"):
        angle = finger.posture.angles()[joint]
        step = units.parse("5 deg", units.ANGLE)
        yield shift(f"posture, {joint}", {f"finger.posture.{joint}": angle}, step, units.ANGLE)
