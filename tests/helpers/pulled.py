"""A sled that moves as it is told, and sheets between it and the ground: for what gives way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.coupling.give_way import GivingMotion
from cosim.coupling.motion import MotionState
from cosim.coupling.schemes import Linear
from cosim.hoods.give_way import GiveWayConfig
from cosim.hoods.giving import GivingFeHood
from cosim.hoods.kind import BuiltHood
from cosim.port import AffineLoad, Array, Motion
from fe_solver.hood.shell_hood import ShellHood
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import NewtonOptions
from fe_solver.supports import SpringLaw, SpringSet, links_of, springs_of

BODIES = ("ground", "sled")
NONE = np.zeros(0)


@dataclass(frozen=True)
class Sled:
    """A finger whose one joint slides at a rate (m/s) along a direction (3,), whatever it bears."""

    rate: float
    along: Array
    bodies = BODIES
    joints = ("slide",)
    tendons = ()

    def angles(self, state: float) -> Array:
        return np.array([self.rate * state])

    def rates(self, state: float) -> Array:
        return np.array([self.rate])

    def motion(self, angles: Array) -> Motion:
        place = np.stack([np.zeros(3), angles[0] * np.asarray(self.along)])
        return Motion(BODIES, place, np.stack([np.eye(3)] * 2))

    def step(self, state: float, load: AffineLoad, tension: Array, dt: float) -> float:
        return state + dt

    def path_lengths(self, angles: Array) -> Array:
        return NONE

    def energy(self, state: float) -> float:
        return 0.0

    def with_tension(self, state: float, tension: Array) -> float:
        return state

    dissipation = device_loss = energy

    def friction_work(self, state: float) -> Array:
        return np.zeros(3)


class NoDrive:
    """No tendons."""

    def start(self, length: Array) -> None:
        return None

    def settle_at(self, state: None, length: Array) -> None:
        return None

    def pull(self, state: None, time: float, length: Array, dt: float) -> Any:
        return type("Pull", (), {"tension": NONE, "state": None})


def pulled(
    model: ShellModel,
    sets: list[SpringSet],
    stated: Mapping[str, Mapping[str, Any]],
    along: Array,
    dt: float,
    rate: float = 1.0,
) -> GivingMotion:
    """A sheet on springs, pulled by a sled at `rate` m/s in steps of `dt` s."""
    sled = Sled(rate, along)
    when = {name: GiveWayConfig.model_validate(values) for name, values in stated.items()}
    hood = GivingFeHood(BuiltHood(on_springs(model, sets, sled)), when)
    return GivingMotion(Linear(), sled, hood, NoDrive(), dt, giving=hood)


def on_springs(model: ShellModel, sets: list[SpringSet], sled: Sled) -> ShellHood:
    """A sheet on springs between the ground and a sled."""
    held = {"springs": springs_of(sets), "links": links_of(sets)}
    model = type(model)(
        **{
            **{f: getattr(model, f) for f in model.__dataclass_fields__},
            **held,
            "groups": tuple(s.name for s in sets),
        }
    )
    carriers = np.full((len(model.reference), 2), 0.5)
    options = NewtonOptions(tolerance=1e-12)
    return ShellHood(model, (), sled.motion(np.zeros(1)), carriers, options, springs=tuple(sets))


def to_body(
    name: str, model: ShellModel, nodes: Array, body: int, reach: Array, stiffness: float
) -> SpringSet:
    """Springs at rest from nodes to points of a body that lie `reach` (3,) m away, of a stiffness
    (N/m) together."""
    anchor = model.reference[nodes] + reach
    law = SpringLaw(stiffness / len(nodes))
    return SpringSet.to_body(name, law, nodes, body, anchor, float(np.linalg.norm(reach)))


def books(moves: GivingMotion, start: MotionState, end: MotionState) -> float:
    """What the work on the sled, the hood's energy and what was lost leave open, J."""
    energy = moves.giving.energy
    stored = energy(end.coupled.hood) - energy(start.coupled.hood)
    return -end.coupled.energy.hood - stored - float(end.events[:, 5].sum())
