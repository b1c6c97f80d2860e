"""Valve, chamber and cylinder: closed forms, invariants, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.errors import InputError
from rigid.air.plant import (
    ATMOSPHERE,
    GAMMA,
    GAS_CONSTANT,
    HEAT_CAPACITY,
    LAMINAR,
    ROOM,
    AirState,
    PneumaticCylinder,
    Pneumatics,
    Valve,
    at_rest,
    fastest,
    flow_function,
    mass_flow,
    openings,
    rates,
    resting_pressure,
    resting_voltage,
    step,
    tension,
)

AIR = Pneumatics()
VOLUME = np.full(3, 6e-6)


def test_the_flow_function_is_iso_6358_s() -> None:
    b = 0.3
    assert flow_function(np.array([0.0, 0.1, b]), b) == pytest.approx([1.0, 1.0, 1.0])
    assert flow_function((1.0 + b) / 2.0, b) == pytest.approx(np.sqrt(0.75))
    near = flow_function(np.array([LAMINAR * (1 - 1e-9), LAMINAR, (1 + LAMINAR) / 2, 1.0]), b)
    assert near[0] == pytest.approx(near[1])
    assert near[2] == pytest.approx(near[1] / 2)
    assert near[3] == 0.0
    assert (np.diff(flow_function(np.linspace(b, 1.0, 500), b)) < 0.0).all()


def test_air_flows_back_as_it_flows_forth_and_faster_when_cold() -> None:
    there = mass_flow(3e-9, 0.3, 6e5, 4e5, ROOM)
    assert there > 0.0
    assert mass_flow(3e-9, 0.3, 4e5, 6e5, ROOM) == -there
    assert mass_flow(3e-9, 0.3, 6e5, 4e5, ROOM / 4.0) == pytest.approx(2.0 * there)
    # 1 dm^3/s per bar of supply, of the reference air
    assert mass_flow(1e-8, 0.3, 7e5, 1e5, ROOM) == pytest.approx(7e-3 * 1.185)


def test_the_edges_open_one_after_the_other() -> None:
    supply, exhaust = openings(Valve(underlap=0.1), np.array([0.0, 4.5, 5.0, 5.5, 7.0, 10.0]))
    assert supply == pytest.approx([0.0, 0.0, 0.1, 0.2, 0.5, 1.0])
    assert exhaust == pytest.approx([1.0, 0.2, 0.1, 0.0, 0.0, 0.0])


def test_the_first_law_holds_in_any_state() -> None:
    """Internal energy grows by what flows in and heats, less the work on the piston."""
    rng = np.random.default_rng(5)
    n = 40
    p = rng.uniform(0.8 * ATMOSPHERE, 1.1 * AIR.valve.supply, n)
    volume, warm = rng.uniform(5e-6, 9e-6, n), rng.uniform(220.0, 400.0, n)
    state = AirState(rng.uniform(0, 10, n), p, p * volume / (GAS_CONSTANT * warm), volume)
    swelling = rng.uniform(-1e-5, 1e-5, n)
    by = rates(AIR, state, rng.uniform(0, 10, n), swelling)
    wide = AIR.valve.conductance * openings(AIR.valve, state.spool)
    enthalpy = mass = np.zeros(n)
    for share, far in zip(wide, (AIR.valve.supply, ATMOSPHERE), strict=True):
        source = np.where(far > p, ROOM, warm)
        flow = mass_flow(share, AIR.valve.critical_ratio, far, p, source)
        enthalpy, mass = enthalpy + HEAT_CAPACITY * source * flow, mass + flow
    inner = (by.pressure * volume + p * swelling) / (GAMMA - 1.0)
    heat = AIR.cylinder.heat * (ROOM - warm)
    assert inner == pytest.approx(enthalpy + heat - p * swelling, rel=1e-12, abs=1e-9)
    assert by.mass == pytest.approx(mass)
    assert np.ptp(mass) > 0.0


def test_many_cylinders_are_as_each_by_itself() -> None:
    volts = np.array([4.0, 5.1, 9.0])
    sizes = PneumaticCylinder(
        bore=np.array([9e-3, 12e-3, 6e-3]), friction=np.array([0.0, 0.1, 0.2])
    )
    start = at_rest(AIR, np.array([5.0, 4.8, 0.0]), VOLUME)
    many = step(Pneumatics(AIR.valve, sizes), start, volts, 1.1 * VOLUME, 1e-3)
    for i in range(3):
        one = step(AIR, AirState(*(a[i : i + 1] for a in start)), volts[i : i + 1],
                   1.1 * VOLUME[:1], 1e-3)  # fmt: skip
        assert one.pressure[0] == pytest.approx(many.pressure[i], rel=1e-4)
        assert one.mass[0] == pytest.approx(many.mass[i], rel=1e-4)


@pytest.mark.parametrize("volts", [0.0, 4.7, 10.0])
def test_long_steps_stay_stable_and_rest(volts: float) -> None:
    """Wide open and with the smallest volume, the flow near rest is stiff."""
    air = Pneumatics(cylinder=PneumaticCylinder(heat=1.0))
    small, command = np.full(1, 2e-6), np.full(1, volts)
    state = at_rest(air, np.full(1, 5.0), small)
    for _ in range(10):
        state = step(air, state, command, small, 0.02)
        assert 0.9 * ATMOSPHERE < state.pressure[0] < 1.05 * air.valve.supply
    assert state.pressure[0] == pytest.approx(resting_pressure(air.valve, command)[0], rel=5e-3)
    assert state.temperature[0] == pytest.approx(ROOM, abs=0.5)


def test_a_fast_valve_and_a_small_chamber_take_small_parts() -> None:
    state = at_rest(AIR, np.full(1, 5.0), np.full(1, 6e-6))
    here = fastest(AIR, state, np.full(1, 5.0), state.volume)
    assert fastest(AIR, state, np.full(1, 10.0), state.volume) > 2.0 * here
    assert fastest(AIR, state, np.full(1, 10.0), 0.5 * state.volume) > 4.0 * here


def test_a_voltage_settles_at_the_pressure_that_it_is_for() -> None:
    wanted = ATMOSPHERE + np.array([0.0, 5e4, 3e5, AIR.valve.supply - ATMOSPHERE])
    volts = resting_voltage(AIR.valve, wanted)
    assert volts[[0, -1]] == pytest.approx([4.5, 5.5])
    assert (np.diff(volts) > 0.0).all()
    assert resting_pressure(AIR.valve, volts) == pytest.approx(wanted)
    assert resting_pressure(AIR.valve, np.array([0.0, 10.0])) == pytest.approx(wanted[[0, -1]])
    rest = at_rest(AIR, volts, np.full(4, 6e-6))
    still = rates(AIR, rest, volts, np.zeros(4))
    assert np.abs(still.pressure).max() < 1.0  # Pa/s
    assert rest.temperature == pytest.approx(np.full(4, ROOM))


def test_a_tendon_is_pulled_and_never_pushed() -> None:
    cylinder = PneumaticCylinder(bore=10e-3, rod=0.0, friction=0.2)
    area = np.pi * 25e-6
    p = ATMOSPHERE + np.array([1e5, 1e5, 1e5, 1e2, -1e4])
    pull = tension(cylinder, p, np.array([0.0, 1.0, -1.0, 1.0, 0.0]))
    assert pull == pytest.approx([area * 1e5, area * 1e5 - 0.2, area * 1e5 + 0.2, 0.0, 0.0])
    assert cylinder.volume(0.01) == pytest.approx(cylinder.dead_volume + 0.01 * area)


def test_90_psi_and_the_rod_s_side_give_the_force() -> None:
    """(0.0093^2 - 0.003^2) pi / 4 times 620528 Pa."""
    cylinder = AIR.cylinder
    assert tension(cylinder, np.array([AIR.valve.supply])) == pytest.approx([37.766], abs=1e-3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Valve(conductance=0.0), "conductance must be above 0"),
        (lambda: Valve(delay=-0.1), "delay must not be negative"),
        (lambda: Valve(critical_ratio=1.0), "critical pressure ratio"),
        (lambda: Valve(supply=ATMOSPHERE), "exceed the atmosphere"),
        (lambda: Valve(underlap=0.0), "underlap above 0"),
        (lambda: PneumaticCylinder(bore=np.array([9e-3, np.nan])), "bore must be above 0"),
        (lambda: PneumaticCylinder(rod=9.3e-3), "thinner than its bore"),
        (lambda: PneumaticCylinder(heat=-1.0), "must not be negative"),
        (lambda: resting_voltage(AIR.valve, ATMOSPHERE - 1.0), "rests between"),
    ],
)
def test_what_no_cylinder_is_is_refused(make: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()  # type: ignore[operator]
