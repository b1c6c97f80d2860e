"""What a run leaves behind: numbers, arrays, forces by source and what there is to see."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.errors import InputError
from cosim.hoods.view import HoodField
from cosim.json_text import json_text
from cosim.port import Array, Finger, Hand, Hood, MovingFinger, mirror
from cosim.results.arrays import Arrays
from cosim.results.conventions import BY_DIRECTION, COMPONENTS, by_axis, by_name
from cosim.version import __version__

if TYPE_CHECKING:
    import xarray

    from cosim.case.schema import Case

LEDGER_HEADER = (
    *("state", "body", "source"),
    *(f"{name}_{unit}" for name, unit in zip(COMPONENTS, 3 * ["N"] + 3 * ["Nmm"], strict=True)),
    "frame",
)


@dataclass(frozen=True)
class Scene:
    """What there is to see, m, world frame."""

    hood: HoodField | None
    bones: tuple[tuple[str, Array, np.ndarray], ...]
    """Name, vertices (n, 3), triangles (m, 3) turning counter-clockwise as seen from outside."""
    tendons: tuple[tuple[str, Array], ...]
    """Name, points (k, 3) in order."""
    tip: tuple[Array, Array] | None = None
    """The fingertip point (3,) and the force of the fingertip on the world (3,) N."""
    frames: tuple[tuple[float, HoodField], ...] = ()
    """The hood over a motion, with the times in s."""
    origins: Mapping[str, Array] = field(default_factory=dict)
    """The origin (3,) of each body, about which its moments are."""
    joints: tuple[tuple[str, Array], ...] = ()
    """The name and the centre (3,) of each joint that bends."""
    pulled: Mapping[str, float] = field(default_factory=dict)
    """N of each tendon that bears more than the resting tension."""
    points: Mapping[str, Array] = field(default_factory=dict)
    """The user's points (3,) on the hood: ink dots."""
    gauges: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """The two points between which each gauge lies."""
    hand: Hand = "right"
    """Pictures and files of the left one show the mirror image."""

    def in_own_frame(self) -> Scene:
        """Return the scene as it is to be shown in space: of a left hand its mirror image."""
        if self.hand == "right":
            return self
        return replace(
            self,
            hood=self.hood and self.hood.of(self.hand),
            bones=tuple((name, mirror(v), faces[:, ::-1]) for name, v, faces in self.bones),
            tendons=tuple((name, mirror(points)) for name, points in self.tendons),
            tip=self.tip and (mirror(self.tip[0]), mirror(self.tip[1])),
            frames=tuple((time, hood.of(self.hand)) for time, hood in self.frames),
            origins={body: mirror(at) for body, at in self.origins.items()},
            joints=tuple((name, mirror(at)) for name, at in self.joints),
            points={name: mirror(at) for name, at in self.points.items()},
            hand="right",
        )


@dataclass(frozen=True)
class LedgerRow:
    """One force on one body from one source, world frame."""

    state: str
    body: str
    source: str
    force: Array
    """(3,) N."""
    moment: Array
    """(3,) N m about the body's origin."""


def ledger_rows(
    state: str, bodies: Sequence[str], wrenches: Mapping[str, Array]
) -> Iterator[LedgerRow]:
    """The rows of one state from the wrenches (nb, 6) by source; what is zero is left out."""
    for b, body in enumerate(bodies):
        for source, wrench in wrenches.items():
            if np.any(wrench[b]):
                yield LedgerRow(state, body, source, wrench[b, :3], wrench[b, 3:])


def joint_forces(
    joint: Array, bodies: Sequence[str], joints: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Bone-to-bone forces (N) by joint, along the world's axes: what the bone distal of a joint
    receives from the one proximal of it through their contact.

    `joint`: (nb, 3 or 6) of what all joints do to each body.  Empty where the joints that bend are
    not one to each body but the first."""
    names = [name for name in joints if not name.endswith("abduction")]
    if len(names) != len(bodies) - 1:
        return {}
    # a bone between two joints receives the one and hands on the other
    through = np.cumsum(joint[:0:-1, :3], axis=0)[::-1]
    return {name: by_axis(force) for name, force in zip(names, through, strict=True)}


def head_block(case: Case, converged: bool, wall: float) -> dict[str, Any]:
    """Say of what case and version a summary is, and in which frame; `wall`: s."""
    frame = BY_DIRECTION[case.finger.side()]
    head = {"case": case.name, "version": __version__, "frame": frame}
    return {**head, "converged": converged, "wall_s": round(wall, 4)}


def force_block(force: Array, in_phalanx: Array | None = None) -> dict[str, Any]:
    """The fingertip's force (3,) N on the world, along its axes and perhaps along those of the
    distal phalanx, and its size."""
    out: dict[str, Any] = {"fingertip_force_N": by_axis(force)}
    if in_phalanx is not None:
        out["fingertip_force_in_phalanx_N"] = by_axis(in_phalanx)
    return {**out, "fingertip_magnitude_N": float(np.linalg.norm(force))}


def state_block(
    finger: Finger | MovingFinger,
    hood: Hood,
    angles: Array,
    tension: Array,
    excursion: Array,
    *force: Array,
) -> dict[str, Any]:
    """Posture (nq,) rad, tensions (N) of the hood's tendons and then the finger's, excursions
    (m) of the hood's, and the `force_block`."""
    return {
        "posture_deg": by_name(finger.joints, np.rad2deg(angles)),
        "tension_N": by_name((*hood.tendons, *finger.tendons), tension),
        "excursion_mm": by_name(hood.tendons, 1e3 * excursion),
        **force_block(*force),
    }


def muscle_block(
    case: Case, lengths: Mapping[str, float], pennation: Array | None = None
) -> dict[str, Any]:
    """What the fibres of each muscle do, by their normalised lengths and their pennation (rad), and
    what the case assumes of them."""
    out: dict[str, Any] = {}
    for i, (name, length) in enumerate(lengths.items()):
        tendon = case.tendons[name]
        out[name] = {"activation": tendon.activation, "normalised_fibre_length": float(length)}
        if pennation is not None:
            out[name]["pennation_deg"] = float(np.rad2deg(pennation[i]))
        assumed = None if tendon.muscle is None else tendon.muscle.fibre_length
        out[name]["assumed_normalised_fibre_length_unloaded"] = assumed
    return {"muscle": out} if out else {}


def hand_of(case_table: Mapping[str, Any]) -> Hand:
    """Return the hand of the finger of a case, as a table."""
    hand: Hand = case_table.get("finger", {}).get("hand", "right")
    return hand


@dataclass(frozen=True)
class CaseParts:
    """What a run leaves behind, before it is written and after it was read."""

    summary: Mapping[str, Any]
    """The numbers one asks for first; every key ends in its unit; written as JSON."""
    arrays: Arrays
    """SI units, along `state` (of a motion along `time`)."""
    rows: tuple[LedgerRow, ...]
    """The ledger: every force on every body by its source."""
    scene: Scene
    """What there is to see; of a run that was read the hood alone, to which `Result.plot` and
    `Result.view` add the finger."""
    case_text: str
    """The case with every default written out, TOML."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "_summary_text", json_text(self.summary))

    def check_unchanged(self) -> None:
        """Check that the summary is still the one that was solved, beside whose arrays it will be
        written.  Raises InputError."""
        if json_text(self.summary) != self.__dict__["_summary_text"]:
            raise InputError(
                f"{self.case}: the summary was changed after it was solved, and does not belong to "
                "the arrays any more; change a copy: copy.deepcopy(result.summary)"
            )

    @cached_property
    def data(self) -> xarray.Dataset:
        """All arrays, SI units, along `state` (of a motion along `time`)."""
        return self.arrays.to_dataset()

    @cached_property
    def case_table(self) -> Mapping[str, Any]:
        """The case as a table."""
        return tomllib.loads(self.case_text)

    @property
    def case(self) -> str:
        """The case's name."""
        return str(self.summary["case"])

    @property
    def hand(self) -> Hand:
        """The hand of the case's finger."""
        return hand_of(self.case_table)

    @property
    def title(self) -> str:
        """The case's title, else its name."""
        return str(self.case_table.get("title", self.case))

    @property
    def axis(self) -> str:
        """What the arrays run along: `time`, s, of a motion, else `state`."""
        return "time" if "time" in self.arrays.dims else "state"

    @property
    def has_history(self) -> bool:
        """Whether there is more than one time: of a motion, and of a load that was held."""
        return self.axis == "time" or "held_time" in self.arrays.dims

    @property
    def hood(self) -> HoodField | None:
        """As it was left at the end; None of a hood without a shape."""
        return self.scene.hood
