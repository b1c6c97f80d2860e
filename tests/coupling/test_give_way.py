"""What gives way in a motion, beside closed forms: chains of springs, a peeled strip, books."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.coupling.adaptive import Control
from cosim.coupling.events import Event
from cosim.coupling.give_way import GivingMotion
from cosim.coupling.motion import MotionState
from cosim.coupling.paced import adaptive_states
from cosim.coupling.state_arrays import Special, flatten, rebuild
from cosim.errors import ConvergenceError
from cosim.hoods.giving import GivingState
from fe_solver.supports import SpringLaw, SpringSet
from tests.helpers.pulled import books, pulled, to_body
from tests.proofs.fe.sheets import clamp, plate, sheet

X, Z = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
SIDE, THICK, MODULUS = 10e-3, 1e-3, 1e11
BLOCK = MODULUS * THICK
"""N/m, of the block between the springs: its modulus times its section over its length."""
FIRST, SPARE, LAST, SECOND = 8e3, 1e3, 5e2, 5e3
"""N/m."""
OTHERS = SPARE + LAST


def chain(dt: float, **stated: dict[str, object]) -> GivingMotion:
    """A stiff block on the springs `first`, `spare` and `last` from the ground, pulled by the
    spring `second` along x at 1 m/s."""
    points, quads = plate(SIDE, SIDE, 1, 1)
    model = sheet(points, quads, MODULUS, 0.0, THICK, bodies=("ground", "sled"))
    left, right = (np.flatnonzero(points[:, 0] == x) for x in (0.0, SIDE))
    sets = [
        to_body("first", model, left, 0, -SIDE * X, FIRST),
        to_body("spare", model, left, 0, -SIDE * X, SPARE),
        to_body("last", model, left, 0, -SIDE * X, LAST),
        to_body("second", model, right, 1, SIDE * X, SECOND),
    ]
    return pulled(model, sets, stated, X, dt)


def moved(moves: GivingMotion, steps: int) -> tuple[MotionState, MotionState]:
    """The states at the start and after some steps."""
    start = moves.begin(0.0)
    at = start
    for _ in range(steps):
        at = moves.advance(at)
    return start, at


def in_series(*stiffness: float) -> float:
    return 1 / sum(1 / k for k in stiffness)


def test_of_a_chain_the_spring_breaks_at_its_force_and_the_rest_of_the_chain_relaxes():
    start, end = moved(moves := chain(1e-3, first={"force": "3.3 N"}), 4)
    event = Event(*end.events[0])
    whole, left = in_series(FIRST + OTHERS, BLOCK, SECOND), in_series(OTHERS, BLOCK, SECOND)
    pull = 3.3 * (FIRST + OTHERS) / FIRST
    assert len(end.events) == 1
    assert event.time == pytest.approx(pull / whole, rel=1e-6)
    assert event.force == pytest.approx(3.3, rel=2e-7)
    assert event.freed == pytest.approx(3.3**2 / 2 / FIRST, rel=1e-6)
    assert event.lost == pytest.approx(event.time**2 / 2 * (whole - left), rel=1e-5)
    assert moves.giving.energy(end.coupled.hood) == pytest.approx(4e-3**2 / 2 * left, rel=1e-5)
    assert abs(books(moves, start, end)) < 1e-6 * abs(end.coupled.energy.hood)


def test_the_order_within_a_step_is_told_by_halving_it():
    """Both would pass their strength in the step; the first to break spares the other."""
    whole = in_series(FIRST + OTHERS, BLOCK, SECOND)
    at_half = 0.5e-3 * whole
    parts = {
        "first": {"force": f"{at_half * FIRST / (FIRST + OTHERS):.12g} N"},
        "second": {"force": f"{1.0001 * at_half:.12g} N"},
    }
    for dt, steps in ((1e-3, 1), (0.1e-3, 10)):
        _, end = moved(chain(dt, **parts), steps)
        assert [row[0] for row in end.events] == [0]
        assert end.events[0, 1] == pytest.approx(0.5e-3, rel=1e-6)


def test_what_the_first_drops_on_another_breaks_it_at_the_same_time():
    parts = {"first": {"force": "3.3 N"}, "spare": {"force": "0.6 N"}}
    start, end = moved(moves := chain(1e-3, **parts), 2)
    assert [row[0] for row in end.events] == [0, 1]
    assert end.events[0, 1] == end.events[1, 1]
    assert (end.events[:, 7] == 0).all()
    assert abs(books(moves, start, end)) < 1e-6 * abs(end.coupled.energy.hood)


def test_equal_parts_give_way_at_once_and_it_is_said():
    """The two springs of one set, each by itself: nothing tells which breaks first."""
    _, end = moved(chain(1e-3, first={"force": "3.3 N", "peels": True}), 2)
    assert len(end.events) == 2
    assert (end.events[:, 7] == 1).all()
    assert end.events[:, 2] == pytest.approx(3.3 / 2, rel=2e-7)


def test_a_stretch_an_energy_and_a_time_end_it_where_they_are_reached():
    whole = in_series(FIRST + OTHERS, BLOCK, SECOND)
    stretch = 3.3 / FIRST
    of_force = 3.3 * (FIRST + OTHERS) / FIRST / whole
    for stated in (
        {"stretch": f"{1e3 * stretch:.12g} mm"},
        {"energy": f"{1e3 * FIRST * stretch**2 / 2:.12g} N*mm"},
        {"time": f"{1e3 * of_force:.12g} ms", "force": "10 N"},
    ):
        _, end = moved(chain(1e-3, first=stated), 2)
        assert end.events[0, 1] == pytest.approx(of_force, rel=1e-6)
        assert end.events[0, 2] == pytest.approx(3.3, rel=1e-6)


def test_what_begins_is_free_of_stress_in_the_shape_of_then():
    begun, u = 1.5e-3, 2e-3
    start, end = moved(moves := chain(1e-3, spare={"begins": "1.5 ms"}), 2)
    before = in_series(FIRST + LAST, BLOCK, SECOND)
    after = in_series(FIRST + OTHERS, BLOCK, SECOND)
    energy = moves.giving.energy
    work = before * begun**2 / 2 + (before * begun + after * (u - begun) / 2) * (u - begun)
    assert energy(end.coupled.hood) == pytest.approx(work, rel=1e-5)
    assert abs(end.events[0, 5]) < 1e-9 * work
    assert abs(books(moves, start, end)) < 1e-6 * work


def test_a_part_lets_go_over_a_time_evenly():
    parts = {"first": {"time": "1 ms", "over_time": "1 ms"}}
    start, end = moved(moves := chain(0.25e-3, **parts), 6)
    half = in_series(FIRST / 2 + OTHERS, BLOCK, SECOND)
    energy = moves.giving.energy(end.coupled.hood)
    assert energy == pytest.approx(1.5e-3**2 / 2 * half, rel=1e-5)
    assert len(end.events) == 1
    assert abs(books(moves, start, end)) < 1e-6 * abs(end.coupled.energy.hood)
    assert moves.giving.bearing(moved(moves, 9)[1].coupled.hood).left == [0.0]


def test_a_part_lets_go_over_a_stretch_along_its_falling_law():
    """The force is k (1 - (s - s0) / d) s beyond s0, here with the pull of a stiff sled."""
    parts = {"first": {"stretch": "0.2 mm", "over_stretch": "1 mm"}}
    start, end = moved(moves := chain(0.1e-3, **parts), 14)
    axial = moves.giving.bearing(end.coupled.hood)
    s = axial.stretch[0]
    assert 0.4e-3 < s < 0.8e-3
    law = FIRST * (1 - (s - 0.2e-3) / 1e-3) * s
    assert axial.force[0] == pytest.approx(law, rel=5e-3)
    assert law + OTHERS * s == pytest.approx((1.4e-3 - s) * in_series(SECOND, BLOCK), rel=5e-3)
    assert abs(books(moves, start, end)) < 1e-6 * abs(end.coupled.energy.hood)


def test_a_motion_goes_on_from_its_arrays_to_the_same_bytes():
    """Stopped before the spring breaks, after it, and as another lets go."""
    parts = {"first": {"force": "3.3 N"}, "spare": {"time": "1.2 ms", "over_time": "2 ms"}}

    def special(moves: GivingMotion) -> Special:
        hood = moves.giving
        return {GivingState: (hood.to_arrays, lambda _, arrays: hood.from_arrays(arrays))}

    moves = chain(0.25e-3, **parts)
    whole = flatten(moved(moves, 9)[1], special(moves))
    for stop in (4, 6, 7):
        kept = flatten(moved(moves, stop)[1], special(moves))
        again = chain(0.25e-3, **parts)
        at = rebuild(again.begin(0.0), kept, special(again))
        for _ in range(9 - stop):
            at = again.advance(at)
        gone_on = flatten(at, special(again))
        assert whole.keys() == gone_on.keys()
        assert all(np.array_equal(whole[name], gone_on[name]) for name in whole)


def test_steps_by_their_error_end_where_a_part_gives_way():
    parts = {"first": {"force": "3.3 N"}, "spare": {"begins": "0.5 ms", "time": "2.5 ms"}}
    moves = chain(1e-3, **parts)
    start = moves.begin(0.0)
    control = Control(tolerance=1e-3, floor=1e-7, ceiling=2e-3)
    times, at = [], start
    for states in adaptive_states(moves, control, start, 3e-3, lambda text: None):
        at = states[-1]
        times += [state.coupled.time for state in states]
    assert [row[0] for row in at.events] == [1, 0, 1]
    assert at.events[0, 1] == pytest.approx(0.5e-3, abs=1e-12)
    assert at.events[1, 2] == pytest.approx(3.3, rel=2e-7)
    assert set(at.events[:, 1]) <= set(times)
    assert abs(books(moves, start, at)) < 1e-6 * abs(at.coupled.energy.hood)


def test_a_hood_that_finds_no_equilibrium_then_says_what_gave_way():
    parts = {name: {"time": "1 ms"} for name in ("first", "spare", "last", "second")}
    with pytest.raises(ConvergenceError, match=r"at t = 0.001 s first, spare, last, second gave"):
        moved(chain(1e-3, **parts), 2)


LONG, WIDE, THIN, ROWS, SOFT = 18e-3, 4e-3, 0.5e-3, 18, 1e9
ARM = 6
"""Elements that lie free at the start."""
GIVES, BED = 0.5e-6, 1.35e6
"""m, and N/m per m of the strip's length, of what holds it."""


def test_a_strip_peels_at_the_force_of_a_beam_on_an_elastic_bed():
    """A strip whose end is lifted, held level, off a bed that breaks at a stretch: the end load of
    a cantilever on a semi-infinite Winkler bed (Kanninen 1973, Int J Fract 9:83)."""
    points, quads = plate(LONG, WIDE, ROWS, 1)
    model = sheet(points, quads, SOFT, 0.0, THIN, bodies=("ground", "sled"))
    model = clamp(model, np.flatnonzero(points[:, 0] > LONG - 1e-6), body=1)
    pitch = LONG / ROWS
    nodes = np.flatnonzero(points[:, 0] < LONG - ARM * pitch - pitch / 2)
    struts = 5e-3 * np.eye(3)
    each = np.repeat(nodes, 3)
    anchors = (points[nodes][:, None] + struts).reshape(-1, 3)
    bed = SpringSet.to_body("bed", SpringLaw(BED * pitch / 2), each, 0, anchors, 5e-3)
    parts = {"bed": {"stretch": f"{1e3 * GIVES:.3g} mm", "peels": True}}
    moves = pulled(model, [bed], parts, Z, 1e-3, rate=1e-3)
    start, end = moved(moves, 3)
    rows = points[nodes[end.events[:, 0].astype(int)], 0]
    assert len(rows) == 6
    assert rows.tolist() == sorted(rows, reverse=True)
    assert abs(books(moves, start, end)) < 1e-6 * abs(end.coupled.energy.hood)
    for row, at in zip(rows[::2], end.events[::2, 1], strict=True):
        assert 1e-3 * at == pytest.approx(lift_at_peel(LONG - row - pitch / 2, pitch), rel=0.015)


def lift_at_peel(arm: float, pitch: float) -> float:
    """The lift (m) of the level end of an arm at which a bed gives way half a pitch inside it."""
    bending = SOFT * WIDE * THIN**3 / 12
    root = (BED / (4 * bending)) ** 0.25

    def unit(load: float, moment: float) -> tuple[float, float, float]:
        """Lift and slope of the bed's end, and the lift half a pitch inside."""
        w = (2 * root * load + 2 * root**2 * moment) / BED
        slope = (2 * root**2 * load + 4 * root**3 * moment) / BED
        x = root * pitch / 2
        inside = 2 * root * load * np.cos(x) + 2 * root**2 * moment * (np.cos(x) - np.sin(x))
        return w, slope, np.exp(-x) * inside / BED

    # the moment at the tip that holds it level under a unit load
    def tip_slope(held: float) -> float:
        return unit(1.0, arm - held)[1] + (arm**2 / 2 - held * arm) / bending

    held = -tip_slope(0.0) / (tip_slope(1.0) - tip_slope(0.0))
    w, slope, inside = unit(1.0, arm - held)
    lift = w + slope * arm + (arm**3 / 3 - held * arm**2 / 2) / bending
    return GIVES / inside * lift
