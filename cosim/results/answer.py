"""What came out of a run, in sentences: terminal, notebook and page begin with them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from cosim.port import AXES
from cosim.results.audit import audit_figures
from cosim.results.compare import value_of
from cosim.results.conventions import OPPOSITE
from cosim.results.give_way import give_way_sentences
from cosim.results.joint_limits import describe_limits
from cosim.results.relaxation import held_sentences

LEAST_FORCE = 5e-4
"""N, below which a fingertip pushes on nothing."""
LEAST_TURN = 0.05
"""deg, below which an abduction is none to tell."""
OTHER_WAY = {axis: way for way, axis in OPPOSITE.items()}
WAYS = ("flexed", "extended"), ("radial", "ulnar")
"""Which way a joint is turned by a positive and by a negative angle: flexion, and abduction."""
Summary = Mapping[str, Any]


def answer(summary: Summary) -> list[str]:
    """Return the sentences of fingertip force, friction of tendons, slips, strain, posture and
    what gave way; what a run lacks is left out."""
    sentences = (
        _force(summary),
        _friction(summary),
        _slips(summary),
        _strain(summary),
        largest_strain(summary),
        _posture(summary),
        *give_way_sentences(summary),
        *held_sentences(summary),
    )
    return [sentence.replace("-", "−") for sentence in sentences if sentence]


def doubts(summary: Summary) -> Iterator[str]:
    """Say what a reader must know before believing a number: motion at the end, joints at limits,
    forces counted twice, strains at which tendons tear, an audit that was missed."""
    if summary.get("came_to_rest") is False:
        yield "The finger was still moving at the end."
    for text in describe_limits(summary):
        yield f"{text}.".replace("-", "−")
    if twice := summary.get("double_counted"):
        yield f"Counted twice: {'; '.join(map(str, twice))}."
    yield from torn(summary)
    if summary.get("audit_missed"):
        yield trust(summary)


def trust(summary: Summary) -> str:
    """Say what the audit found."""
    missed = summary.get("audit_missed")
    if missed is None:
        return "This run kept no audit."
    if missed:
        return f"The audit was missed in: {', '.join(name.replace('_', ' ') for name in missed)}."
    count = len(audit_figures(summary))
    return f"All {count} checks of the audit were kept." if count > 1 else "The audit was kept."


def _force(summary: Summary) -> str:
    force = [value_of(summary, f"fingertip_force_N.{axis}") for axis in AXES]
    values = [f for f in force if f is not None]
    if len(values) < len(AXES):
        return ""
    size = math.hypot(*values)
    if size <= LEAST_FORCE:
        return "The fingertip pushes on nothing."
    split = ", ".join(
        f"{abs(f):.2f} {axis if f >= 0 else OTHER_WAY[axis]}"
        for axis, f in zip(AXES, values, strict=True)
    )
    when = "Under load" if "unloaded" in summary else "At the end"
    rest = _at_rest(summary, "fingertip_magnitude_N")
    return f"{when}, the fingertip pushes with {size:.2f} N ({split}){rest}."


def _friction(summary: Summary) -> str:
    ways = ("loading", "unloading")
    sizes = [value_of(summary, f"friction.sliding.{c}.fingertip_magnitude_N") for c in ways]
    if sizes[0] is None or sizes[1] is None or max(sizes[0], sizes[1]) <= LEAST_FORCE:
        return ""
    return (
        f"With friction it is {sizes[0]:.2f} N where all tendons slide towards their muscles "
        f"(loading) and {sizes[1]:.2f} N where all slide back (unloading)."
    )


def _slips(summary: Summary) -> str:
    carried = "; ".join(
        f"the {slip} slip carries {value:.2f} N{_at_rest(summary, f'slip_force_N.{slip}')}"
        for slip, value in summary.get("slip_force_N", {}).items()
    )
    return f"{carried[0].upper()}{carried[1:]}." if carried else ""


def _strain(summary: Summary) -> str:
    strain = summary.get("strain_percent", {}).get("longitudinal")
    if not strain or "p5" not in strain:  # of a run of an earlier version
        return ""
    return (
        f"Longitudinal strain over 90 % of the central region: {strain['p5']:.2f} to "
        f"{strain['p95']:.2f} %, mean {strain['mean']:.2f} %."
    )


def _posture(summary: Summary) -> str:
    angles = {joint: float(angle) for joint, angle in summary.get("posture_deg", {}).items()}
    if not angles:
        return ""
    parts = [
        _turned(j, q) for j, q in angles.items() if not _is_abduction(j) or abs(q) >= LEAST_TURN
    ]
    return f"The finger stands at {', '.join(parts)}."


def _turned(joint: str, angle: float) -> str:
    ways = WAYS[_is_abduction(joint)]
    name = joint.replace("_abduction", "").replace("_", " ")
    return f"{name} {abs(angle):.1f}° {ways[angle < 0]}"


def _is_abduction(joint: str) -> bool:
    return joint.endswith("abduction")


def _at_rest(summary: Summary, quantity: str) -> str:
    """A force of the unloaded state in words, to follow that of the loaded one."""
    value = value_of(summary, f"unloaded.{quantity}")
    return "" if value is None else f", {value:.2f} N at rest"


TEARS = 10.0
"""%, strain of straight fibres from which on tendons tear when they are tested: some 10 to 15 %, an
order of size and no measurement of a hood, whose tissue tears at larger strains than tendons
(Qian et al. 2014, abstract; their numbers were not read)."""


class FibreStrain(NamedTuple):
    """A region's strain along its fibres, and beyond the strain at which they are straight, %: the
    95th percentile over its area, since extremes of single quads grow as a mesh gets finer.  What
    may tear fibres with a toe is their strain beyond that at which they are straight."""

    region: str
    strain: float
    beyond: float

    @property
    def words(self) -> str:
        """The strain with its region, and what the fibres do there."""
        text = f"{self.strain:.2f} % in the {self.region.replace('_', ' ')}"
        if self.beyond < 0 < self.strain:
            return f"{text}, whose fibres are not straight yet"
        if self.beyond < self.strain - 1.5:
            text = f"{text}, {self.beyond:.2f} % beyond straight"
        return f"{text}, at which tendons tear" if self.beyond > TEARS else text


def fibre_strains(summary: Summary) -> list[FibreStrain]:
    """The regions of a sheet, the most strained first; none of another hood."""
    found = summary.get("fibre_strain_percent", {}).items()
    pairs = ((name, strain.get("p95"), strain.get("beyond_straight")) for name, strain in found)
    return sorted((FibreStrain(*p) for p in pairs if None not in p), key=lambda s: -s.strain)


def largest_strain(summary: Summary) -> str:
    """Say where the fibres are strained most, and most beyond straight; empty without a sheet."""
    each = fibre_strains(summary)
    if not each:
        return ""
    most, taut = each[0], max(each, key=lambda s: s.beyond)
    more = "" if taut is most else f"; of straight fibres, {taut.words}"
    return f"Largest strain along the fibres (95th percentile of a region): {most.words}{more}."


def torn(summary: Summary) -> Iterator[str]:
    """Say in which regions the strain is one at which tendons tear."""
    overloaded = [s for s in fibre_strains(summary) if s.beyond > TEARS]
    if overloaded:
        where = ", ".join(f"{s.region.replace('_', ' ')} ({s.beyond:.0f} %)" for s in overloaded)
        yield (
            f"Strained by more than {TEARS:.0f} % beyond straight: {where}. Tendons tear at some "
            "10 to 15 %; in the model nothing tears."
        )
