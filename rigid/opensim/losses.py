"""What an import dropped or changed, element by element."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from rigid.opensim.xml import OsimTag

LOOKS = (
    *("FrameGeometry", "Appearance", "attached_geometry", "ModelVisualPreferences", "color"),
    *("VisibleObject", "display_preference"),
)
"""Tags that only say how a model is drawn."""
REASONS = (
    ("Constraint", "nothing holds this constraint: the coordinates it ties together are free"),
    ("Controller", "controllers are not imported: the actuators wait for a tension"),
    ("Probe", "probes measure and change nothing"),
    ("HuntCrossley", "contact is not imported"),
    ("ElasticFoundation", "contact is not imported"),
    ("SmoothSphere", "contact is not imported"),
    ("Contact", "contact is not imported"),
    ("Bushing", "no joint or tendon of MuJoCo is this force; it is not applied"),
    ("Force", "no joint or tendon of MuJoCo is this force; it is not applied"),
    ("Ligament", "ligaments are not imported; the force is not applied"),
    ("Spring", "this force is not imported and not applied"),
    ("Actuator", "only actuators with a <GeometryPath> are imported"),
    ("Muscle", "a muscle without a <GeometryPath> is not imported"),
    ("Wrap", "no imported path wraps over it"),
    ("Frame", "nothing imported is fixed to this frame"),
    ("prescribed_function", "coordinates follow no function here"),
)
"""Reason by what the kind of an element holds; the first that fits."""


NEUTRAL = {"default_speed_value": "0", "is_free_to_satisfy_constraints": "false"}
"""What some tags say where they say nothing."""
GROUPS = {
    "unasked": "that were not asked for",
    "drawn": "that only say how things are drawn",
}


@dataclass(frozen=True)
class Loss:
    """An element that is not in the MJCF, or is there as something else; those of a `group` are
    told in one line."""

    what: Literal["dropped", "changed"]
    place: str
    line: int
    reason: str
    group: Literal["", "drawn", "unasked"] = ""

    def __str__(self) -> str:
        return f"{self.what}, line {self.line}: {self.place}: {self.reason}"


def change_of(tag: OsimTag, reason: str) -> Loss:
    """Return the loss that says why an element is something else in the MJCF."""
    return Loss("changed", tag.place, tag.line, reason)


def drop(tag: OsimTag, reason: str) -> Loss:
    """Return the loss of an element; it and all within it count as read from now on."""
    tag.pass_over()
    return Loss("dropped", tag.place, tag.line, reason)


def unasked(tag: OsimTag) -> Loss:
    """Return the loss of an element that was not asked for; all within it counts as read."""
    tag.pass_over()
    return Loss("dropped", tag.place, tag.line, "it was not asked for", "unasked")


def unread(root: OsimTag) -> Iterator[Loss]:
    """One loss per element that nothing has read; empty ones hold nothing that could be lost."""
    for tag in root.unread():
        if tag.kind in LOOKS:
            yield Loss("dropped", tag.place, tag.line, "how things are drawn", "drawn")
        elif tag.children or tag.text.strip() not in ("", NEUTRAL.get(tag.kind, "")):
            yield Loss("dropped", tag.place, tag.line, _reason(tag.kind))


def _reason(kind: str) -> str:
    reasons = (reason for part, reason in REASONS if part in kind)
    return next(reasons, "it has no counterpart in the MJCF")


def report(losses: tuple[Loss, ...]) -> list[str]:
    """A line per element, in the file's order, and one per group."""
    lines = [str(loss) for loss in sorted(losses, key=lambda x: x.line) if not loss.group]
    for group, what in GROUPS.items():
        count = sum(loss.group == group for loss in losses)
        if count:
            lines.append(f"dropped: {count} elements {what}")
    return lines or ["nothing was dropped or changed"]
