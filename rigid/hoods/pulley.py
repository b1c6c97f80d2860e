"""A hood of cables through frictionless eyelets: closed forms of everything the port asks.

Cable of length L(p) through points p_0 (guide) ... p_n (insertion) at tension T, pulled at p_0
along the unit vector d:

    force on point i:  F_i = -T dL/dp_i + [i = 0] T d,     excursion  x = L_rest - L + c T

with c the series compliance.  T dx is the work of the forces as long as the guide's body rests:
the excursion is measured in that body, which the pull turns and moves with.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, HoodJacobian, Load, Motion, Response, check_step, skew
from rigid.chain.kinematics import Indices

SOURCES = ("pulley", "insertion")
Point = tuple[str, tuple[float, float, float]]


@dataclass(frozen=True)
class Cable:
    """A tendon: its eyelets from the guide to the insertion, each (body, m in that body's frame).

    `direction` (unit after construction): where the muscle pulls, in the frame of the guide's body;
    `compliance`: of what lies in series with the cable, m/N."""

    points: tuple[Point, ...]
    direction: tuple[float, float, float] = (-1.0, 0.0, 0.0)
    compliance: float = 0.0

    def __post_init__(self) -> None:
        length = math.hypot(*self.direction)
        if len(self.points) < 2 or length == 0.0 or not self.compliance >= 0.0:
            raise InputError(
                "cable: expected at least a guide and an insertion, a direction other than zero "
                f"and a compliance (m/N) that is not negative; got {self}"
            )
        object.__setattr__(self, "direction", tuple(x / length for x in self.direction))


@dataclass(frozen=True)
class PulleyState:
    motion: Motion
    tension: Array


@dataclass(frozen=True)
class _Line:
    """A cable in the world at one motion."""

    body: Indices
    """(n,) index of each point's body."""
    point: Array
    lever: Array
    """(n, 3) world points, and the same from their bodies' origins."""
    pull: Array
    """(3,) the unit vector d."""
    length: float
    gradient: Array
    """(n, 3) dL/dp."""
    hessian: Array
    """(3 n, 3 n) d2L/dp2."""


class PulleyHood:
    """A hood of inextensible cables without friction or mass; any number of bodies and points.

    `rest` is the motion at which all excursions are zero at no tension.

    Raises InputError for an unknown body or two neighbouring points in one place.

    >>> import numpy as np
    >>> from cosim.port import Motion
    >>> from rigid.hoods.pulley import Cable, PulleyHood
    >>> bones = Motion(("a", "b"), np.array([[0.0, 0, 0], [0.04, 0, 0]]), np.array([np.eye(3)] * 2))
    >>> cable = Cable((("a", (0.02, 0.0, 0.008)), ("b", (0.01, 0.0, 0.005))))
    >>> hood = PulleyHood({"EDC": cable}, bones)
    >>> response = hood.advance(hood.start(bones), bones, np.array([2.0]), 1.0)
    >>> wrench = response.load.wrench.sum(axis=1)  # (2, 6) N, N m about each body's origin
    >>> bool(wrench[1, 4] < 0)  # it extends the second body
    True
    """

    sources = SOURCES

    def __init__(self, cables: Mapping[str, Cable], rest: Motion) -> None:
        self.bodies, self.tendons = rest.bodies, tuple(cables)
        self._cables = dict(cables)
        for name, cable in cables.items():
            unknown = [body for body, _ in cable.points if body not in self.bodies]
            if unknown:
                raise InputError(f"cable {name}: unknown body {unknown[0]}, not in {self.bodies}")
        self._body = {
            name: np.array([self.bodies.index(body) for body, _ in cable.points])
            for name, cable in cables.items()
        }
        self._seen: tuple[Motion, list[_Line]] | None = None
        self._rest = np.array([line.length for line in self._lines(rest)])

    def start(self, motion: Motion) -> PulleyState:
        check_step("pulley hood", self, motion, np.zeros(len(self.tendons)), math.inf)
        return PulleyState(motion, np.zeros(len(self.tendons)))

    def advance(self, state: PulleyState, motion: Motion, tension: Array, dt: float) -> Response:
        """Response at `motion` under `tension` (nt,) N; it depends on no rate and no history, so
        that any `dt` > 0 gives the same.  Raises InputError."""
        check_step("pulley hood", self, motion, tension, dt)
        tension = np.array(tension, dtype=float)
        wrench = np.zeros((len(self.bodies), len(SOURCES), 6))
        pulls, excursion = [], self._compliance() * tension + self._rest
        for k, line in enumerate(self._lines(motion)):
            force = tension[k] * _unit_forces(line)
            source = np.where(np.arange(len(force)) == len(force) - 1, 1, 0)
            moment = np.cross(line.lever, force)
            np.add.at(wrench, (line.body, source), np.hstack([force, moment]))
            pull = tension[k] * line.pull
            pulls.append(np.concatenate([pull, np.cross(line.point[0], pull)]))
            excursion[k] -= line.length
        load = Load(self.bodies, SOURCES, wrench, np.reshape(pulls, (-1, 6)))
        return Response(PulleyState(motion, tension), load, excursion)

    def jacobian(self, state: PulleyState) -> HoodJacobian:
        n, nt = 6 * len(self.bodies), len(self.tendons)
        stiffness, by_tension, excursion = np.zeros((n, n)), np.zeros((n, nt)), np.zeros((nt, n))
        for k, line in enumerate(self._lines(state.motion)):
            rate = self._point_rates(line)
            stiffness += state.tension[k] * _motion_stiffness(line, rate)
            by_tension[:, k] = rate.T @ _unit_forces(line).ravel()
            excursion[k] = -line.gradient.ravel() @ rate
        return HoodJacobian(stiffness, by_tension, excursion, np.diag(self._compliance()))

    def with_tolerance(self, tolerance: float) -> PulleyHood:
        """Itself: closed forms leave no residual."""
        return self

    def _point_rates(self, line: _Line) -> Array:
        """The velocities (3 n, 6 nb) of the points per twist of the bodies."""
        rate = np.zeros((len(line.body), 3, len(self.bodies), 6))
        i = np.arange(len(line.body))
        rate[i, :, line.body, :3] = np.eye(3)
        rate[i, :, line.body, 3:] = -skew(line.lever)
        return rate.reshape(3 * len(i), -1)

    def _compliance(self) -> Array:
        return np.array([cable.compliance for cable in self._cables.values()])

    def _lines(self, motion: Motion) -> list[_Line]:
        """The cables, those of the last motion kept: an answer and its derivatives ask for the same
        one."""
        if self._seen is None or self._seen[0] is not motion:
            cables = self._cables.items()
            self._seen = motion, [_line(n, cable, self._body[n], motion) for n, cable in cables]
        return self._seen[1]


def _line(name: str, cable: Cable, body: Indices, motion: Motion) -> _Line:
    turn = motion.rotation[body]
    lever = np.einsum("nij,nj->ni", turn, np.array([p for _, p in cable.points]))
    point = motion.position[body] + lever
    segment = np.diff(point, axis=0)
    length = np.linalg.norm(segment, axis=1)
    if not (length > 0).all():
        k = int(np.argmin(length))
        raise InputError(
            f"cable {name}: points {k} and {k + 1} coincide, so that the cable has no direction "
            "there; move or drop one"
        )
    gradient, hessian = _length_derivatives(segment, length)
    pull = turn[0] @ cable.direction
    return _Line(body, point, lever, pull, float(length.sum()), gradient, hessian)


def _length_derivatives(segment: Array, length: Array) -> tuple[Array, Array]:
    """dL/dp (n, 3) and d2L/dp2 (3 n, 3 n) of a polyline."""
    unit = segment / length[:, None]
    n = len(unit) + 1
    gradient, hessian = np.zeros((n, 3)), np.zeros((n, 3, n, 3))
    gradient[1:] += unit
    gradient[:-1] -= unit
    curvature = (np.eye(3) - unit[:, :, None] * unit[:, None, :]) / length[:, None, None]
    for i, block in enumerate(curvature):
        hessian[i, :, i] += block
        hessian[i + 1, :, i + 1] += block
        hessian[i, :, i + 1] -= block
        hessian[i + 1, :, i] -= block
    return gradient, hessian.reshape(3 * n, 3 * n)


def _unit_forces(line: _Line) -> Array:
    """The forces (n, 3) on the points per unit of tension."""
    force = -line.gradient
    force[0] += line.pull
    return force


def _motion_stiffness(line: _Line, rate: Array) -> Array:
    """The derivative (6 nb, 6 nb) of the wrenches at unit tension over the twists: of the forces,
    with the pull turning with the guide's body, and of their levers."""
    out = -rate.T @ line.hessian @ rate
    guide = slice(6 * line.body[0] + 3, 6 * line.body[0] + 6)
    out[:, guide] -= rate[:3].T @ skew(line.pull)
    for b, lever, force in zip(line.body, skew(line.lever), skew(_unit_forces(line)), strict=True):
        turn = slice(6 * b + 3, 6 * b + 6)
        out[turn, turn] += force @ lever
    return out
