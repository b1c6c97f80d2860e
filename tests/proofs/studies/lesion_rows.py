"""Injuries and repairs of the hood beside what a clinician sees.

A finger that is free to move is solved with and without the lesion, the shell's under the tone of
all muscles that its case states, the others under EDC and FDP.  What must come out is a sign, by
definition of the deformities: a boutonniere finger's PIP lags in flexion and its DIP extends, a
mallet finger's DIP drops and, as it becomes a swan neck, its PIP extends.  No figure of such a
change was seen, so none is a target.
"""

from __future__ import annotations

from collections.abc import Iterator

from cosim.analyses.lesion import SIDES, both_sides
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.pipeline import run_case
from tests.helpers.rows import Row

LEAST = 0.1
"""deg, of a change that is one."""
CLINIC = "definition of the deformity; a sign, no figure"
YOUNG = "Young and Rayan 2000, abstract; a sign, no figure"
FREE = ("finger.tip.kind=free", 'finger.limit.half_range="40 deg"')
EXTENDING = ('tendons.EDC.tension="5 N"', 'tendons.FDP.tension="1 N"')
EVEN = ('tendons.EDC.tension="3 N"', 'tendons.FDP.tension="3 N"')
HOODS = {
    "shell": "lesion_mallet",
    "net of cables": "cable_edc",
    "network": "network_edc",
    "two bands": "two_band_edc",
}
"""Case of each kind of hood that knows both slips."""
CUTS = {"boutonniere": "central_slip", "mallet": "terminal_slip"}
SIGNS = {
    "boutonniere": {"PIP": 1.0, "DIP": -1.0},
    "mallet": {"PIP": -1.0, "DIP": 1.0},
}
"""Signs of the change of the angle, flexion positive."""
KNOWN_MISSES = {("mallet", "net of cables", "PIP")}
"""What a hood does not show: the PIP under a net of cables flexes where it should extend."""


def cut_case(hood: str, part: str) -> Case:
    """The case of a hood of HOODS with a part cut."""
    alone = () if hood == "shell" else (*FREE, *EXTENDING)
    return load_case(HOODS[hood], [*alone, f'lesion.cut=["{part}"]'])


def changes(case: Case) -> dict[str, float]:
    """The change (deg) by joint, after the case's lesion less before, fingertip free."""
    sides = both_sides(case)
    before, after = (
        run_case(sides["free", side]).summary["posture_deg"] for side in ("before", "after")
    )
    return {joint: after[joint] - before[joint] for joint in after}


def sign_rows() -> Iterator[Row]:
    """Both slips cut in every kind of hood that has them."""
    for injury, part in CUTS.items():
        for hood in HOODS:
            turns = changes(cut_case(hood, part))
            for joint, sign in SIGNS[injury].items():
                what = f"{joint}, deg of {'extension' if sign > 0 else 'flexion'} gained"
                is_known = (injury, hood, joint) in KNOWN_MISSES
                yield sign_row(f"{injury}, {hood}", what, -sign * turns[joint], is_known)


def tendon_shift() -> float:
    """How far (mm) the extensor tendon goes to the radial side by a cut of the radial band."""
    sides = both_sides(load_case("lesion_sagittal_band_radial"))
    before, after = (run_case(sides["free", s]).summary["tendon_shift_mm"] for s in SIDES)
    return float(after - before)


def sign_row(name: str, what: str, gained: float, is_known_miss: bool) -> Row:
    """What was gained (deg), which must be a loss; a known miss is shown beside that and not
    judged."""
    if is_known_miss:
        beyond = max(-LEAST - gained, 0.0)
        return Row(name, what, -LEAST, gained, beyond, f"{CLINIC}; a known miss", "comparison")
    return Row(name, what, -LEAST, gained, 0.0, CLINIC, "bound")


def repair_rows() -> Iterator[Row]:
    """A slip too short and a band that sticks cost flexion; a retracted slip makes a swan neck; the
    extensor tendon leaves the MCP towards the ulnar side without its radial band."""
    turns = changes(load_case("lesion_terminal_shortened"))
    what = "DIP, deg of flexion gained by 1 mm"
    yield Row("terminal slip too short", what, -LEAST, turns["DIP"], 0.0, CLINIC, "bound")
    turns = changes(load_case("lesion_adhesion"))
    what = "PIP, deg of flexion gained"
    yield Row("central band on the bone", what, -LEAST, turns["PIP"], 0.0, CLINIC, "bound")
    neck, mallet = (changes(load_case(f"lesion_{name}"))["PIP"] for name in ("swan_neck", "mallet"))
    what = "PIP, deg of flexion gained over the mallet finger"
    yield Row("swan neck", what, -LEAST, neck - mallet, 0.0, CLINIC, "bound")
    what = "tendon, mm gained to the radial side"
    yield Row("radial sagittal band cut", what, -LEAST, tendon_shift(), 0.0, YOUNG, "bound")


def doubtful_rows() -> Iterator[Row]:
    """What the default hood does not show, and why, beside hoods that do."""
    for hood, name in HOODS.items():
        turn = changes(load_case(name, [*FREE, *EVEN, 'lesion.cut=["terminal_slip"]']))["PIP"]
        what = "PIP change deg under EDC 3 N, FDP 3 N; extends below 0"
        yield Row(f"mallet, {hood}", what, min(turn, 0.0), turn, 0.0, CLINIC, "comparison")
