"""The sweeps of the board of curves: `cases/data/curves.toml`, one joint that moves in each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from math import degrees
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.port import Array
from cosim.roughness import WINDOW
from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import Count, Switch, Table
from cosim.text_tables import read_toml
from cosim.validation.records import check_record

FILE = "curves.toml"
Joint = Literal["MCP", "PIP", "DIP"]
JOINTS: tuple[Joint, ...] = ("MCP", "PIP", "DIP")
ANGLE_ROUNDING = 1e-9
"""deg, of angles that are sums of steps."""
Angle = Annotated[float, quantity(units.ANGLE, least="-30 deg", most="110 deg")]


class SweepConfig(Table):
    """A case at postures in equal steps of one joint."""

    case: str
    """Name of a packaged case."""
    settings: tuple[str, ...] = ()
    """Values of every run, as KEY=VALUE."""
    joint: Joint
    """The joint that moves; the others stay where the case has them."""
    first: Angle
    """First angle."""
    last: Angle
    """Last angle, at least a window beyond the first."""
    step: Annotated[float, quantity(units.ANGLE, least="0.5 deg", most="5 deg")]
    """From angle to angle."""
    follow: dict[Joint, float] = Field(default_factory=dict)
    """Joints that move too, and the share of the angle that each has."""
    full: Switch = False
    """Whether it is run with `--full` alone."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if degrees(self.last - self.first) < WINDOW - ANGLE_ROUNDING:
            raise fault(f"last must be at least {WINDOW:g} deg beyond first, a window")
        if self.joint in self.follow:
            raise fault(f"follow names {self.joint}, the joint that moves")
        return self

    @property
    def angles(self) -> Array:
        """The angles (n,), deg."""
        first, last, step = (degrees(a) for a in (self.first, self.last, self.step))
        return np.round(np.arange(first, last + ANGLE_ROUNDING, step), 9)


class SweepsFile(Table):
    """The file."""

    meshes: tuple[Annotated[Count, Field(ge=60, le=5000)], ...] = ()
    """Quads of a generated hood on which every sweep is repeated with `--full`."""
    sweeps: Annotated[dict[str, SweepConfig], Field(min_length=1)]
    """The sweeps by name."""


class PostureSweep(NamedTuple):
    """A sweep with its cases."""

    name: str
    joint: Joint
    angles: Array
    """(n,), deg."""
    postures: Mapping[Joint, Array]
    """(n,) of each joint, deg."""
    cases: tuple[Case, ...]
    pulled: Mapping[str, float]
    """Tension (N) of each tendon that is pulled."""


def read_sweeps(
    full: bool = False, settings: Sequence[str] = (), only: str = "", path: Path | None = None
) -> list[PostureSweep]:
    """The sweep of the name `only`, or those whose name holds it, with `settings` on top; `full`:
    all of the file, and on its meshes.  Raises InputError for a file at fault, or no sweep."""
    path = path or Path(str(resources.files("cases") / "data" / FILE))
    file = check_record(SweepsFile, read_toml(path), path)
    known = {name: c for name, c in file.sweeps.items() if full or not c.full}
    kept = {n: c for n, c in known.items() if n == only or (only in n and only not in known)}
    if not kept:
        raise InputError(f"{only!r}: no sweep has this name; `cosim validate --curves --list` has")
    found = []
    for name, config in kept.items():
        try:
            found.append(_sweep(name, config, settings))
            own = found[-1].cases[0].hood.generated_quads
            for quads in sorted({*file.meshes} - {own}) if full and own else ():
                more = (*settings, f"hood.mesh.quads={quads}")
                found.append(_sweep(f"{name}, {quads} quads", config, more))
        except InputError as error:
            raise InputError(f"{path}: sweeps.{name}: {error}") from None
    return found


def _sweep(name: str, config: SweepConfig, settings: Sequence[str]) -> PostureSweep:
    case = load_case(config.case, [*config.settings, *settings])
    posture = case.native_finger().posture.angles()
    angles = config.angles
    postures = {joint: np.full(len(angles), round(degrees(posture[joint]), 9)) for joint in JOINTS}
    postures[config.joint] = angles
    postures |= {joint: np.round(share * angles, 4) for joint, share in config.follow.items()}
    cases = tuple(
        case.replace(
            {f"finger.posture.{joint}": f"{postures[joint][i]:.9g} deg" for joint in JOINTS},
            name=f"{name} {angle:g} deg",
        )
        for i, angle in enumerate(angles)
    )
    tensions = {tendon: case.tension(tendon) for tendon in case.tendons}
    pulled = {t: n for t, n in tensions.items() if n > case.solve.resting_tension}
    return PostureSweep(name, config.joint, angles, postures, cases, pulled)
