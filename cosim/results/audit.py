"""The audit of a run: the bound of each of its figures, and what to try where one is exceeded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from cosim.results.compare import number, numbers_of, value_of


@dataclass(frozen=True)
class Bound:
    """The largest value of a figure with which a result is trusted, and what to try beyond it."""

    most: float
    advice: str


CLOSURE = "a hood is massless: its forces on the bones must balance the tendons' pulls on it"
SMALLER_TOLERANCE = "write a smaller solve.tolerance"
STEP = (
    "hood and finger drift apart in time: write a smaller forward.step, a table forward.adaptive, "
    'or coupling.scheme = "newton"'
)
TWO = (
    "another start leads to another equilibrium (second_start in summary.json): which one a finger "
    "is in depends on how it was loaded; load it in a motion (forward), change what lets the hood "
    "go slack, or write a smaller solve.tolerance"
)
HOOD_BALANCES = ("hood_force_balance", "hood_moment_balance")
"""The figures of `Load.imbalance`."""
BOUNDS = {
    **dict.fromkeys(HOOD_BALANCES, Bound(1e-9, CLOSURE)),
    "finger_residual": Bound(1e-6, SMALLER_TOLERANCE),
    "interface_residual": Bound(1e-6, f"{SMALLER_TOLERANCE} or coupling.tolerance"),
    "reciprocity": Bound(
        1e-3,
        "arms by force and by excursion differ; a larger hood.contact.stiffness in place of "
        f"augmented contact or friction can help, else {SMALLER_TOLERANCE}",
    ),
    "tip_force_over_reach": Bound(
        2.0,
        "the fingertip force is more than the tendons can make: the hood pushes by stress that it "
        "has at rest (unloaded.joint_torque_Nmm.hood); write moduli of tendon, or lay the hood "
        "nearer to the posture (hood.mesh.rest_posture); or tendons that slide back hold more by "
        "friction than their muscles pull (tendons.NAME.friction)",
    ),
    "torque_balance_at_rest": Bound(1e-3, "write a longer forward.duration"),
    "largest_interface_residual": Bound(0.05, STEP),
    "energy_put_in_over_effort": Bound(0.01, STEP),
    "max_penetration_mm": Bound(
        0.02,
        'write a larger hood.contact.stiffness ("500 N/mm**3"), or hood.contact.penetration = '
        '"1 um"',
    ),
    "layer_used_up": Bound(
        0.8,
        "the tissue between hood and bone is used up; write larger moduli (hood.contact.layer) or "
        "heights (hood.contact.offset), or pull with less",
    ),
    "guide_depth_mm": Bound(
        0.05, "a tendon's line runs into the bone: raise its end on the metacarpal"
    ),
    "friction_beyond_cone": Bound(
        1e-4,
        "friction exceeds its coefficient times the normal force; write a smaller "
        "hood.contact.stiffness or a smaller solve.hood_tolerance",
    ),
    "friction_work_made": Bound(
        1e-9, "friction drives the hood in place of holding it; load it in smaller steps"
    ),
    "hood_unstable_modes": Bound(
        0,
        "the hood stands where the least push would move it away, as a strut that buckles; write "
        "another hood.mesh.quads, or change posture or tension a little",
    ),
    "unstable_modes_bones_free": Bound(
        0,
        "hood and finger stand where the least push on a joint would move them away; change "
        'posture or tension a little, or write coupling.scheme = "newton"',
    ),
    "second_start_force_N": Bound(1e-3, TWO),
    "second_start_angle_deg": Bound(1e-2, TWO),
}
"""By the figure's name in the summary: in its audit, or beside it."""
POSTURE, AT_REST, LITTLE_DAMPING = "posture_in_range", "at_rest", "little_numerical_damping"
MOST_DAMPING = 0.05
"""What the method itself may take of the tendons' work in a motion whose path is the result."""
ADVICE = {
    POSTURE: "a joint stands far beyond its range of motion; hold the fingertip, or pull with less",
    AT_REST: "the finger still moves at the end (last_rate_rad_per_s, last_force_change_N); write "
    "a longer forward.duration, damping or passive stiffness of the joints, hold the fingertip at "
    "a point, or write forward.must_rest = false",
    LITTLE_DAMPING: f"the method itself took more than {MOST_DAMPING:.0%} of the tendons' work "
    f"(artificial_energy_over_effort), so that its path is damped; {STEP}",
}
"""What to try where a run misses what has no figure."""


NOT_RECIPROCAL = (
    "with friction, arms by force and by excursion differ by what sticks; the balance, "
    "Coulomb's cone (friction_beyond_cone) and the sign of friction's work (friction_work_made) "
    "are held to in its place"
)
"""Why the reciprocity of moment arms says nothing of a hood with friction."""

PATH_DEPENDENT = "with friction the load depends on the path, so that two starts may differ"


@dataclass(frozen=True)
class Audit:
    """The audit of a run: its figures, their bounds, and what it missed."""

    figures: Mapping[str, float]
    missed: tuple[str, ...]

    @classmethod
    def read(cls, summary: Mapping[str, Any]) -> Audit:
        """That of a summary."""
        return cls(audit_figures(summary), tuple(summary.get("audit_missed", ())))

    @property
    def passed(self) -> bool:
        """Whether every figure is within its bound."""
        return not self.missed

    @property
    def bounds(self) -> dict[str, float]:
        """The largest value that each figure may have; those without a bound are left out."""
        return {name: BOUNDS[name].most for name in self.figures if name in BOUNDS}

    def __str__(self) -> str:
        return "audit passed" if self.passed else f"AUDIT MISSED: {', '.join(self.missed)}"


def audit_figures(summary: Mapping[str, Any]) -> dict[str, float]:
    """The figures of a summary's audit, and those beside it that have a bound."""
    beside = {name: summary[name] for name in BOUNDS if name in summary}
    return {**summary.get("audit", {}), **beside}


def missed_bounds(summary: Mapping[str, Any], **kept: bool) -> list[str]:
    """What a run missed: the figures of its summary that are beyond their bounds or not a number,
    and those names of `ADVICE` that are not `kept`."""
    figures = audit_figures(summary)
    missed = [n for n, bound in BOUNDS.items() if n in figures and not figures[n] <= bound.most]
    return [*missed, *(name for name, held in kept.items() if not held)]


def describe_misses(summary: Mapping[str, Any]) -> Iterator[str]:
    """A sentence for each figure that a run missed: its value, its bound, what to try; and for each
    number in which two equilibria differ most."""
    figures = audit_figures(summary)
    for name in summary.get("audit_missed", ()):
        words = name.replace("_", " ")
        if name in BOUNDS and name in figures:
            bound, value = BOUNDS[name], figures[name]
            beyond = f"more than {bound.most:g}" if value > bound.most else "no number"
            yield f"{words} is {value:.2g}, {beyond}: {bound.advice}"
        else:
            yield f"{words}: {ADVICE[name]}" if name in ADVICE else words
    second = summary.get("second_start", {})
    for path, change in numbers_of(second.get("difference", {})).items():
        of_each = [number(value_of(start, path)) for start in (summary, second)]
        yield f"{path}: {of_each[0]}, and {of_each[1]} from a second start ({change:+.2g})"
