"""Force sharing in the flexion of Buchner, Hines and Hemami 1988, beside the paper's figures.

The weights of the paper's costs are not printed; equal ones here.  Others leave the linear
programme's forces as they are; what they do to the quadratic one's has rows of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import brentq

from cases.papers.models.buchner1988.coordination import ControlLoop, deviation, flex
from cases.papers.models.buchner1988.coordination_findings import feasible, findings, flexion
from cases.papers.models.buchner1988.flexion import (
    DURATION,
    FULL,
    Course,
    cosine,
    curve_motion,
    quintic,
    torques,
)
from cases.papers.models.buchner1988.force_sharing import Sharing, linear, quadratic
from cases.papers.models.printed import read_printed
from cosim.port import Array
from rigid.chain.planar_chain import BUCHNER
from rigid.hoods.two_band import ELASTICITY, MUSCLES, TABLE_1, Entry, coupled_dip, two_band
from rigid.muscle.least_cost import ACCURATE, Power, Programme, least
from tests.helpers.rows import Row

PAPER = "Buchner, Hines and Hemami 1988, J Biomech 21, section III, figures 8-14"
ABOUT = 0.5
"""N, what the paper's "about" is taken for, which it does not state: compared only."""
READ = 0.01
"""s, of times read off the figures; they are compared only, since the paper does not state its
course in time."""
SEEN = 1.0
"""deg, what can be told apart in the paper's figures 5 and 7; compared only."""
PIP = np.linspace(0.0, FULL, 201)
HALF = np.zeros((2, len(MUSCLES)))
HALF[:, 0] = 0.5
EQUAL = np.ones(len(MUSCLES))
AREAS = np.array([1.39, 4.79, 4.79, 2.80 + 3.53, 0.28])
"""cm2, of EC, FP, FS, UI with RI, and LU in AnyBody's index finger (after Wu 2008)."""
ED, FDP, FDS, INT, LUM = range(5)


@dataclass(frozen=True)
class Programmes:
    """Muscles' forces over time, on a course along the coupling curve, where the shifts agree."""

    course: Course
    table: Mapping[tuple[str, str], Entry]

    def at(self, time: float) -> tuple[Array, Array]:
        """Joint angles and torques, (3,) each."""
        angle, rate, acceleration = curve_motion(np.array(time), self.course)
        return angle, torques(BUCHNER, angle, rate, acceleration)

    def linear(self, time: float) -> Sharing:
        """With half of ED's tension in either band."""
        network = two_band(table=self.table)
        return linear(network, *self.at(time), HALF, np.zeros(2), EQUAL)

    def quadratic(self, time: float, weight: Array = EQUAL) -> Sharing:
        """Return the forces by the quadratic programme with the muscles' cost `weight` at a time
        (s)."""
        return quadratic(two_band(table=self.table), *self.at(time), weight)

    def fall(self, weight: Array) -> float:
        """The force, N, by which the quadratic programme's ED falls."""
        start, end = (self.quadratic(t, weight).muscles[ED] for t in (0.0, DURATION))
        return float(start - end)

    def crossing(self) -> float:
        """The time, s, when the middle band begins to bear more than the lateral one."""
        return float(brentq(self._lead, 0.01 * DURATION, 0.9 * DURATION, xtol=1e-6))

    def change(self) -> float:
        """The time, s, when the linear programme's FDS falls silent and the interossei begin."""
        return float(brentq(self._flex, 0.01 * DURATION, 0.9 * DURATION, xtol=1e-6))

    def _flex(self, time: float) -> float:
        muscles = self.linear(time).muscles
        return float(muscles[FDS] - muscles[INT])

    def _lead(self, time: float) -> float:
        middle, lateral = self.quadratic(time).bands
        return float(middle - lateral)


def rows() -> Iterator[Row]:
    """Both programmes at the ends and in between, and what the uncertain entries change."""
    flexion = Programmes(quintic, TABLE_1)
    yield from _linear_rows(flexion)
    yield from _quadratic_rows(flexion)
    yield from _sensitivity_rows()
    yield from _loop_rows()
    yield from _programme_rows()


def _loop_rows() -> Iterator[Row]:
    """The flexion that closes the loop over a linear reference, as
    `cases.papers.models.buchner1988.coordination` has it."""
    f = flexion(samples=101)
    row = partial(Row, "flexion in closed loop", source=PAPER)
    ours = findings(f)
    for printed in read_printed("buchner1988"):
        about, unit = printed.about, printed.unit
        much = {"N": ABOUT if about else 0.05, "s": READ, "deg": SEEN, "%": 0.5}[unit]
        yield row(
            f"{printed.item}, {unit}",
            printed.values[0],
            ours[printed.ours],
            much,
            measure="comparison" if about else "absolute",
        )
    off = deviation(f.loop, f.motion)
    yield row("from the parabola at most, deg", 0.0, off.curve, SEEN, measure="comparison")
    apart = float(np.degrees(np.abs(coupled_dip(PIP) - PIP * coupled_dip(PIP[-1:]) / FULL).max()))
    yield row("from the line at most, deg", apart, off.line, SEEN, measure="comparison")
    stiff = ControlLoop(elasticity=10 * ELASTICITY)
    far = deviation(stiff, flex(stiff, 101)).curve
    yield row("from the parabola with K over that with 10 K", 10.0, off.curve / far, 0.1)
    literal = ControlLoop(bands_answer=False)
    on = deviation(literal, flex(literal, 101)).line
    yield row("equation 17 literally: from the line, deg", 0.0, on, 1e-6, measure="absolute")
    for share, target in ((0.5, 1.0), (1.0, 0.0)):
        part = feasible(replace(f.loop, lateral_share=share), f.motion)
        name = f"part of the time with forces, alpha {share:g}"
        yield row(name, target, part, 0.0, measure="absolute")


def _programme_rows() -> Iterator[Row]:
    """Programmes of random equations and bounds, solved and checked."""
    rng = np.random.default_rng(0)
    powers: tuple[Power, ...] = (1, 2, 3)
    worst = dict.fromkeys(powers, 0.0)
    for _ in range(100):
        n, m = int(rng.integers(4, 10)), int(rng.integers(1, 4))
        A = rng.normal(size=(m, n)) * np.exp(rng.normal(0.0, 2.0, (m, 1)))
        most = np.where(rng.random(n) < 0.5, rng.uniform(1.0, 50.0, n), np.inf)
        inside = rng.random(n) * np.minimum(most, 30.0)
        cost = np.exp(rng.normal(size=n))
        cost[: n // 4] = 0.0
        for power in powers:
            found = least(Programme(A, A @ inside, np.zeros(n), most), cost, power)
            worst[power] = max(worst[power], np.inf if found is None else found.miss)
    for power, name in zip(powers, ("linear", "quadratic", "cubic"), strict=True):
        yield Row(
            f"{name} programmes",
            "most missed of equations and optimality, relative",
            0.0,
            worst[power],
            ACCURATE,
            "conditions of Karush, Kuhn and Tucker, 100 random programmes",
            measure="absolute",
        )


def _linear_rows(flexion: Programmes) -> Iterator[Row]:
    name = "linear programme, alpha 1/2"
    row = partial(Row, name, source=PAPER)
    end = flexion.linear(DURATION)
    yield row("ED at the end, N", 26.4, float(end.muscles[ED]), 0.05, measure="absolute")
    yield row("middle band at the end, N", 13.2, float(end.bands[0]), 0.05, measure="absolute")
    yield row("FDP at the end, about, N", 9.5, float(end.muscles[FDP]), ABOUT, measure="comparison")
    yield row(
        "Int at the end, about, N", 18.0, float(end.muscles[INT]), ABOUT, measure="comparison"
    )
    times = np.linspace(0.0, DURATION, 41)
    force = np.array([flexion.linear(t).muscles for t in times])
    together = float(np.minimum(force[:, FDS], force[:, INT]).max())
    yield row("most of FDS and Int at once, N", 0.0, together, 1e-9, measure="absolute")
    yield row("most of Lum, N", 0.0, float(force[:, LUM].max()), 1e-9, measure="absolute")
    change = flexion.change()
    yield row("FDS gives way to Int, s", 0.22, change, READ, measure="comparison")


def _quadratic_rows(flexion: Programmes) -> Iterator[Row]:
    name = "quadratic programme, alpha free"
    row = partial(Row, name, source=PAPER)
    both = [flexion.quadratic(t) for t in (0.0, DURATION)]
    start, end = both
    share = end.bands / end.muscles[ED]
    fall = start.muscles - end.muscles
    yield row("middle band's share at the end", 0.72, float(share[0]), 0.005, measure="absolute")
    yield row("lateral band's share at the end", 0.28, float(share[1]), 0.005, measure="absolute")
    yield row("ED falls by, about, N", 7.5, float(fall[ED]), ABOUT, measure="comparison")
    yield row("FDP falls by, about, N", 3.5, float(fall[FDP]), ABOUT, measure="comparison")
    times = np.linspace(0.0, DURATION, 41)
    others = max(float(flexion.quadratic(t).muscles[FDS:].max()) for t in times)
    yield row("most of FDS, Int, Lum, N", 0.0, others, 1e-9, measure="absolute")
    yield row("bands cross, about, s", 0.22, flexion.crossing(), READ, measure="comparison")
    lead = float(start.bands[1] / start.muscles[ED])
    yield row(
        "lateral band's share less 1/2 at first, least 0", 0.0, 0.5 - lead, 0.0, measure="bound"
    )


def _sensitivity_rows() -> Iterator[Row]:
    """What is not certain: the course in time, FDS's arm at the PIP, read as 7 mm, the weights."""
    row = partial(Row, "what is not certain", tolerance=READ, source=PAPER, measure="comparison")
    yield row("bands cross, on a cosine in time, s", 0.22, Programmes(cosine, TABLE_1).crossing())
    for radius in (5e-3, 9e-3):
        table = dict(TABLE_1) | {("FDS", "PIP"): Entry(radius)}
        change = Programmes(quintic, table).change()
        yield row(f"FDS gives way, its PIP arm {1e3 * radius:g} mm, s", 0.22, change)
    falls = partial(row, tolerance=ABOUT)
    flexion = Programmes(quintic, TABLE_1)
    yield falls("ED falls by, areas of AnyBody's index finger, N", 7.5, flexion.fall(AREAS))
    apart = np.where(np.arange(len(MUSCLES)) == FDS, 3.0, 1.0)
    apart[FDP] = 1 / 3
    yield falls("ED falls by, FDS's area nine times FDP's, N", 7.5, flexion.fall(apart))
