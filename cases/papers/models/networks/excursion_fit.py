"""Arms and slack of a finger with an extensor mechanism from excursions and joint coupling.

Development and Validation of Modeling Framework for Interconnected Tendon Networks in Robotic and
Human Fingers, section IV-B: where tendons cross joints themselves, excursions are of second order
in each angle,

    l = c + sum_j b_j theta_j + a_j theta_j^2 / 2,    r_j = b_j + a_j theta_j,

and fit by least squares.  Those of the extensors go on over a slip and a lateral band, whichever is
taut (11; the forces at which excursions are measured hardly stretch a tendon, so that the shorter
one counts), with the slip's arm at the PIP and the terminal band's at the DIP constant and the
lateral band's at the PIP of first order.  On the coupling curve both are taut (figure 6),

    l_LB(theta) = l_ES(theta),

which joins the fit as rows of its own, each over its standard deviation as the excursions' are: the
DIP angle that this asks for, beside the measured one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from cases.papers.models.networks.share_models import ShareFinger
from cosim.port import Array
from rigid.hoods.network import Arms

EXTENSOR = ("slip PIP", "lateral PIP", "lateral PIP slope", "terminal DIP", "slack")
"""What both extensors share: m, m, m/rad, m, and m by which the lateral band is longer than the
slip with all joints straight."""
START = np.array([-5e-3, -4e-3, 1e-3, -3e-3, 0.0])


@dataclass(frozen=True)
class MeasuredKinematics:
    """What was measured."""

    angle: Array
    """(n, 3) rad."""
    excursion: Array
    """(n, 4) m of FDP, FDS, EDC and LUM, each from a length of its own."""
    spread: float
    """m, standard deviation of an excursion."""


@dataclass(frozen=True)
class JointCoupling:
    """Where PIP and DIP stood with the extensors taut."""

    angle: Array
    """(n, 3) rad."""
    spread: float
    """rad, standard deviation of each angle."""

    @property
    def deviation(self) -> Array:
        """The deviation (n,) rad of the DIP off the curve: of both angles, by the curve's slope (of
        a parabola through the points)."""
        pip, dip = self.angle[:, 1], self.angle[:, 2]
        slope = np.polyval(np.polyder(np.polyfit(pip, dip, 2)), pip)
        return self.spread * np.hypot(1.0, slope)


@dataclass(frozen=True)
class Identified:
    """The fit's parameters with their covariance."""

    names: tuple[str, ...]
    value: Array
    """(p,) m and m/rad."""
    covariance: Array
    """(p, p)."""
    rms: float
    """m, of the excursions' residuals."""

    @property
    def deviation(self) -> Array:
        """The standard deviations (p,) of the parameters, m and m/rad."""
        return np.sqrt(np.diag(self.covariance))

    def finger(self, length: Array) -> ShareFinger:
        """The model's finger: FDP, FDS, EDC, LUM."""
        by = dict(zip(self.names, self.value, strict=True))
        direct = np.zeros((2, 3, 4))
        for k, muscle in enumerate(("FDP", "FDS", "EDC", "LUM")):
            for j, joint in enumerate(("MCP", "PIP", "DIP")):
                direct[0, j, k] = by.get(f"{muscle} {joint}", 0.0)
                direct[1, j, k] = by.get(f"{muscle} {joint} slope", 0.0)
        slip, lateral = (np.zeros((2, 3, 1)) for _ in range(2))
        slip[0, 1] = by["slip PIP"]
        lateral[0, 1], lateral[1, 1] = by["lateral PIP"], by["lateral PIP slope"]
        lateral[0, 2] = by["terminal DIP"]
        return ShareFinger(
            length, Arms(*direct), Arms(*slip), Arms(*lateral), np.array([0.0, 0.0, 1.0, 1.0])
        )


def dip_of_pip(parameters: Array, pip: Array) -> Array:
    """The DIP angle, rad, on the coupling curve of the parameters EXTENSOR at PIP angles (rad)."""
    slip, lateral, slope, terminal, slack = parameters
    return -((lateral - slip) * pip + 0.5 * slope * pip**2 + slack) / terminal


def identify(measured: MeasuredKinematics, coupling: JointCoupling | None = None) -> Identified:
    """All arms, with the coupling's rows where there are any."""
    own = [
        _of_muscle(measured, 0, "FDP", ("MCP", "PIP", "DIP")),
        _of_muscle(measured, 1, "FDS", ("MCP", "PIP")),
        _of_extensors(measured, coupling),
    ]
    names = tuple(name for part in own for name in part.names)
    size = np.cumsum([0, *(len(part.names) for part in own)])
    covariance = np.zeros((size[-1], size[-1]))
    for part, a, b in zip(own, size, size[1:], strict=False):
        covariance[a:b, a:b] = part.covariance
    value = np.concatenate([part.value for part in own])
    weights = np.array([1, 1, 2])
    rms = float(np.sqrt(np.average([part.rms**2 for part in own], weights=weights)))
    return Identified(names, value, covariance, rms)


def _of_muscle(
    measured: MeasuredKinematics, column: int, muscle: str, joints: tuple[str, ...]
) -> Identified:
    """Linear least squares of one muscle that crosses the joints itself."""
    basis = _second_order(measured.angle[:, : len(joints)])
    value = np.linalg.lstsq(basis, measured.excursion[:, column], rcond=None)[0].astype(float)
    off = basis @ value - measured.excursion[:, column]
    covariance = np.linalg.inv(basis.T @ basis).astype(float) * measured.spread**2
    names = [f"{muscle} {joint}{word}" for joint in joints for word in ("", " slope")]
    return Identified(
        (*names, f"{muscle} length"), value, covariance, float(np.sqrt((off**2).mean()))
    )


def _second_order(angle: Array) -> Array:
    """The regressors (n, 2 j + 1): theta_j and theta_j^2 / 2 of each joint, and 1."""
    terms = np.stack([angle, 0.5 * angle**2], axis=-1).reshape(len(angle), -1)
    return np.hstack([terms, np.ones((len(angle), 1))])


def _of_extensors(measured: MeasuredKinematics, coupling: JointCoupling | None) -> Identified:
    """EDC and LUM at the MCP and the two ways that they share, by Gauss and Newton."""
    at_mcp, wanted = _second_order(measured.angle[:, :1]), measured.excursion[:, 2:]
    n, none = at_mcp.shape[1], np.zeros((len(at_mcp), at_mcp.shape[1]))
    slip, lateral = _way_rows(measured.angle)

    def rows(p: Array) -> Array:
        """The excursions' derivatives (2 n, p), which are linear while the same way is taut."""
        taut = np.where((slip @ p[2 * n :] < lateral @ p[2 * n :])[:, None], slip, lateral)
        return np.vstack([np.hstack([at_mcp, none, taut]), np.hstack([none, at_mcp, taut])])

    def residuals(p: Array) -> Array:
        off = (rows(p) @ p - wanted.T.ravel()) / measured.spread
        return np.concatenate([off, curve_distance(p[2 * n :], coupling)])

    def slopes(p: Array) -> Array:
        on_curve = curve_distance_slopes(p[2 * n :], coupling)
        still = np.zeros((len(on_curve), 2 * n))
        return np.vstack([rows(p) / measured.spread, np.hstack([still, on_curve])])

    start = np.concatenate([np.zeros(2 * n), START])
    found = least_squares(residuals, start, slopes, method="lm", xtol=1e-12, ftol=1e-12)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    off = measured.spread * found.fun[: wanted.size]
    names = [f"{m} {word}" for m in ("EDC", "LUM") for word in ("MCP", "MCP slope", "length")]
    rms = float(np.sqrt((off**2).mean()))
    return Identified((*names, *EXTENSOR), found.x, covariance, rms)


def _way_rows(angle: Array) -> tuple[Array, Array]:
    """The rows of both ways (n, 5): derivatives of l_ES and l_LB by the parameters EXTENSOR."""
    pip, dip = angle[:, 1], angle[:, 2]
    no, one = np.zeros_like(pip), np.ones_like(pip)
    slip = np.stack([pip, no, no, no, no], axis=1)
    return slip, np.stack([no, pip, 0.5 * pip**2, dip, one], axis=1)


def curve_distance(parameters: Array, coupling: JointCoupling | None) -> Array:
    """How far (n,) the measured points lie from the curve of the parameters, over their spread: the
    distance in angle, which unlike the lengths' difference does not shrink with the arms."""
    if coupling is None:
        return np.zeros(0)
    away = coupling.angle[:, 2] - dip_of_pip(parameters, coupling.angle[:, 1])
    return away / coupling.deviation


def curve_distance_slopes(parameters: Array, coupling: JointCoupling | None) -> Array:
    """The derivatives (n, 5) of `curve_distance` by the parameters."""
    if coupling is None:
        return np.zeros((0, len(EXTENSOR)))
    slip, lateral = _way_rows(coupling.angle)
    apart, dip = lateral - slip, dip_of_pip(parameters, coupling.angle[:, 1])
    apart[:, 3] = dip
    return apart / parameters[3] / coupling.deviation[:, None]
