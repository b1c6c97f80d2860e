"""What a surgeon would see of a lesion, in words by rules, beside what is printed of it.

The rules look at a finger before and after, its fingertip free: at how far its joints turned, at
where the lateral bands lie, at the forces of the slips and at the extensor tendon over the MCP."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from cosim.results.result import Result

STRAIGHT = 5.0
"""deg, from which a straight joint stands at most."""
SEEN = 5.0
"""deg, of a change that a surgeon would see."""
DEFORMED = 30.0
"""deg, of a lag that is a deformity and no mere loss of extension."""
SHIFTED = 2.0
"""mm, of a tendon that has left its place."""
STIFFER = 2.0
"""How many times as much a terminal slip bears that stiffens the DIP."""
TESTED = (80.0, 100.0)
"""deg, of a PIP that is held for Elson's test."""
FLEXIONS = ("MCP", "PIP", "DIP")


class Sign(NamedTuple):
    """What is seen, and what is printed of such a lesion."""

    seen: str
    printed: str


@dataclass(frozen=True)
class Findings:
    """A free finger before and after the lesion, which cut the parts `cut`, others partly."""

    before: Mapping[str, Any]
    after: Mapping[str, Any]
    cut: frozenset[str]
    cut_partly: frozenset[str] = frozenset()

    def turn(self, joint: str) -> float:
        """How much further (deg) the joint is flexed after the lesion."""
        return self.angle(joint) - float(self.before["posture_deg"].get(joint, 0.0))

    def angle(self, joint: str) -> float:
        """deg, after the lesion."""
        return float(self.after["posture_deg"].get(joint, 0.0))

    def is_tested(self) -> bool:
        """Whether the PIP is held as Elson's test holds it."""
        low, high = TESTED
        return low < self.angle("PIP") < high and abs(self.turn("PIP")) < 1.0


def clinical_signs(before: Result, after: Result) -> list[Sign]:
    """What a surgeon would see of two runs with the fingertip free; the intact finger first."""
    lesion = after.case_table.get("lesion", {})
    cut, partly = (frozenset(lesion.get(key, ())) for key in ("cut", "cut_partly"))
    found = Findings(before.summary, after.summary, cut, partly)
    if "posture_deg" not in found.before or "posture_deg" not in found.after:
        return []
    signs = [sign for rule in RULES for sign in rule(found)]
    nothing = Sign(f"No joint changes by {SEEN:g} deg: a surgeon would see nothing.", "")
    return [_intact(found.before["posture_deg"]), *(signs or [nothing])]


def _intact(posture: Mapping[str, float]) -> Sign:
    angles = {joint: posture[joint] for joint in FLEXIONS if joint in posture}
    bent = max(map(abs, angles.values()), default=0.0) > STRAIGHT
    said = ", ".join(f"{joint} {round(angle)}" for joint, angle in angles.items())
    return Sign(f"The intact finger {'stands' if bent else 'is straight,'} at {said} deg.", "")


def _mallet(f: Findings) -> Iterator[Sign]:
    if f.turn("DIP") >= SEEN and not f.is_tested():
        is_cut = "terminal_slip" in f.cut
        printed = "clinic 30 to 50 deg; 45 in cadavers, as quoted" if is_cut else ""
        name = ": a mallet finger" if is_cut else ""
        yield Sign(f"The DIP droops by {f.turn('DIP'):.0f} deg{name}.", printed)


def _swan_neck(f: Findings) -> Iterator[Sign]:
    if f.angle("PIP") <= -SEEN and f.angle("DIP") >= SEEN:
        yield Sign(
            f"The PIP is hyperextended by {-f.angle('PIP'):.0f} deg: a swan neck.",
            "by definition PIP hyperextended, DIP flexed",
        )


GRAU = (
    "Grau et al. 2017, abstract, 18 hands: the slip alone, a loss of extension and no deformity; "
    "transverse and oblique fibres too, more of it; a deformity with the triangular ligament"
)


def _pip_lag(f: Findings) -> Iterator[Sign]:
    lag = f.turn("PIP")
    if lag < SEEN:
        return
    heights = f.after.get("lateral_band_height_mm", {}).values()
    is_deformed = lag >= DEFORMED and bool(heights) and max(heights) < 0
    where = "; the lateral bands lie palmar of its axis and flex it" if is_deformed else ""
    name = "a boutonniere deformity" if is_deformed else "a loss of extension"
    printed = GRAU if "central_slip" in f.cut else ""
    yield Sign(f"The PIP lags by {lag:.0f} deg{where}: {name}.", printed)
    if (more := -f.turn("DIP")) >= 1.0:
        yield Sign(f"The DIP is {more:.0f} deg further extended.", "extended, by definition")


def _elson(f: Findings) -> Iterator[Sign]:
    if not f.is_tested() or "terminal" not in f.after.get("slip_force_N", ()):
        return
    intact, cut = (float(s["slip_force_N"]["terminal"]) for s in (f.before, f.after))
    is_stiff = cut >= STIFFER * intact and f.turn("DIP") < 0
    name = "stiff, Elson's test is positive" if is_stiff else "floppy, Elson's test is negative"
    yield Sign(
        f"With the PIP at {f.angle('PIP'):.0f} deg the terminal slip bears {cut:.1f} N, intact "
        f"{intact:.1f} N, and the DIP stands at {f.angle('DIP'):.0f} deg: {name}.",
        "the DIP is stiff with the central slip cut, floppy intact (20 fingers, abstract)",
    )


def _subluxation(f: Findings) -> Iterator[Sign]:
    shift = f.after.get("tendon_shift_mm", 0.0) - f.before.get("tendon_shift_mm", 0.0)
    bands = {part for part in f.cut if part.startswith("sagittal_band")}
    if abs(shift) >= SHIFTED:
        side = "radial" if shift > 0 else "ulnar"
        seen = f"The extensor tendon slips {abs(shift):.1f} mm to the {side} side of the MCP."
    elif bands:
        seen = "The extensor tendon stays over the MCP."
    else:
        return
    yield Sign(
        seen,
        "a radial cut dislocates the tendon to the ulnar side, an ulnar one does nothing (Young "
        "and Rayan 2000, abstract)"
        if bands
        else "",
    )


def _mcp_lag(f: Findings) -> Iterator[Sign]:
    tendon = "extensor_tendon_distal"
    if tendon in f.cut or tendon in f.cut_partly or f.turn("MCP") >= SEEN:
        printed = "9 to 15 deg under 3 kg (Arvind et al., abstract, six hands)"
        if tendon in f.cut_partly:
            printed = "a lag from 75 % of the width on (Chan et al. 2019, abstract, eight hands)"
        elif tendon not in f.cut:
            printed = ""
        yield Sign(f"The MCP loses {max(f.turn('MCP'), 0.0):.0f} deg of extension.", printed)


def _lost_flexion(f: Findings) -> Iterator[Sign]:
    for joint in ("PIP", "DIP"):
        if f.turn(joint) <= -SEEN and f.before["posture_deg"].get(joint, 0.0) >= DEFORMED:
            yield Sign(f"The {joint} loses {-f.turn(joint):.0f} deg of flexion.", "")


RULES: tuple[Callable[[Findings], Iterator[Sign]], ...] = (
    *(_mallet, _swan_neck, _pip_lag, _elson, _subluxation, _mcp_lag, _lost_flexion),
)


def sign_sentences(signs: Collection[Sign]) -> list[str]:
    """Each sign as a line of text."""
    return [s.seen + (f" In print: {s.printed}." if s.printed else "") for s in signs]
