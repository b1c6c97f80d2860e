"""Pneumatic cylinders as what pulls a case's tendons: motion, history, checkpoints, refusals."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.case.file import load_case, resolved_toml
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError, StoppedError
from cosim.pipeline import run_case
from cosim.results.history_plot import draw_history
from cosim.results.result import Result
from cosim.solve.session import Session
from cosim.tendons.air import cylinders, initial_air, step_cylinders
from rigid.air.plant import ATMOSPHERE, PneumaticCylinder

PLAIN = "output.picture=false"
AREA = float(np.asarray(PneumaticCylinder().area))
SHORT = ('forward.duration="0.12 s"', "forward.checkpoint=40")


def air(command: str, tendon: str = "EDC") -> str:
    return f'tendons.{tendon}.actuation={{kind="pneumatic",{command}}}'


def run_motion(name: str, *settings: str) -> Result:
    return run_case(load_case(name, [PLAIN, *settings]))


def test_a_wanted_pressure_ends_as_its_tension_does() -> None:
    ramp = 'tendons.EDC.signal={kind="points",at=[["0 s",0.2],["0.1 s",1.0]]}'
    by_air = run_motion("split_edc", 'forward={duration="1 s"}', air('pressure="0.057 MPa"'), ramp)
    force = AREA * 57e3
    stated = run_motion("split_edc", 'forward={duration="1 s"}', f'tendons.EDC.tension="{force} N"')
    assert by_air.summary["tension_N"]["EDC"] == pytest.approx(force, rel=1e-4)
    assert by_air.summary["fingertip_force_N"] == pytest.approx(
        stated.summary["fingertip_force_N"], abs=1e-4
    )
    data = by_air.data
    pressure, pull = data.pressure.sel(cylinder="EDC"), data.own_tension.sel(muscle="EDC")
    assert float(pressure[0]) == pytest.approx(0.2 * 57e3)  # at rest under the first command
    rubbed = np.abs(pull.values - AREA * pressure.values)
    assert rubbed.max() <= 0.06  # the friction, and the air as a spring within a step
    assert rubbed[-1] < 1e-4
    volts = data.command.sel(cylinder="EDC").values
    assert volts[0] < volts[50] < volts[100] == volts[-1]
    felt = int(np.argmax(pressure.values > float(pressure[0]) * 1.01))
    assert 30 <= felt <= 40  # ms
    assert by_air.summary["air"]["EDC"]["pressure_kPa"] == pytest.approx(57.0, rel=1e-4)


class MotionStopper:
    """Progress that interrupts a motion, as Ctrl-C does."""

    def __call__(self, text: str) -> None:
        if text.startswith("t = "):
            raise KeyboardInterrupt


def test_a_cut_off_motion_goes_on_to_the_same_bytes_and_its_books_close(tmp_path: Path) -> None:
    early = 'tendons.FDP.signal={kind="points",at=[["0 s",0.97],["0.02 s",1.0]]}'
    case = load_case("pneumatic_edc_fdp", [PLAIN, *SHORT, early])
    whole = run_case(case)
    with pytest.raises(StoppedError, match="Go on with"):
        run_case(case, Session(checkpoints=tmp_path), MotionStopper())
    gone = run_case(case, Session(checkpoints=tmp_path))
    for name in whole.data.data_vars:
        assert whole.data[name].values.tobytes() == gone.data[name].values.tobytes()
    assert np.ptp(whole.data.pressure.values, axis=0).min() > 1e3
    assert whole.summary["audit_missed"] == []
    assert whole.summary["audit"]["artificial_energy_over_effort"] < 0.05
    figure = draw_history(whole.data, "air")
    panels = {axes.get_ylabel(): axes for axes in figure.axes}
    assert {"valve voltage, V", "pressure, kPa"} < set(panels)
    pulled = panels["tension of the tendons\nthat are pulled, N"]
    drawn = {line.get_label(): line.get_ydata()[-1] for line in pulled.lines}
    assert drawn["EDC"] == float(whole.data.tension.sel(tendon="EDC")[-1])
    assert drawn["FDP"] == float(whole.data.own_tension.sel(muscle="FDP")[-1])


def test_at_the_start_the_pistons_stand_where_they_are_stated() -> None:
    """The hood's excursion on the way to its first equilibrium is none of theirs."""
    case = ['forward.duration="0.02 s"', 'forward.step="1 ms"']
    data = run_motion("pneumatic_edc_fdp", *case).data
    assert np.abs(np.diff(data.pressure.values, axis=0)).max() < 500.0  # Pa in 1 ms, no command


def test_the_chamber_s_volume_follows_the_tendon() -> None:
    """A shut valve: p V^gamma is constant, and the piston drawn in pulls less."""
    shut = 'voltage="5 V",conductance="1e-12 mm**3/s/Pa",heat="0 W/K",friction="0 N"'
    case = load_case("split_edc", ["forward={}", air(shut), air('pressure="0.1 MPa"', "FDP")])
    live = cylinders(case.tendons, ("FDS", "FDP", "EDC"))
    assert live is not None
    assert live.names == ("FDP", "EDC")
    assert live.where.tolist() == [1, 2]
    state = initial_air(live)
    first = step_cylinders(live, state, 0.0, np.zeros(2), 0.0)
    inward = np.array([0.0, 5e-3])
    done = step_cylinders(live, state, 1e-2, inward, 1e-2)
    ratio = state.volume[1] / (state.volume[1] + AREA * 5e-3)
    assert done.state.pressure[1] == pytest.approx(state.pressure[1] * ratio**1.4, rel=1e-6)
    assert done.state.pressure[0] == pytest.approx(ATMOSPHERE + 1e5, rel=1e-6)
    assert done.tension[1] < first.tension[1]
    assert np.all(first.stiffness == 0.0)
    slight = step_cylinders(live, state, 1e-2, np.array([0.0, -1e-6]), 1e-2)
    slope = (slight.tension[1] - first.tension[1]) / 1e-6
    assert slight.stiffness[1] == pytest.approx(slope, rel=1e-3)


@pytest.mark.parametrize(("inward", "words"), [(0.02, "drawn in to"), (-0.02, "drawn out to")])
def test_a_piston_at_its_end_stops_the_run(inward: float, words: str) -> None:
    live = cylinders(load_case("split_edc", ["forward={}", air('voltage="5 V"')]).tendons, ("EDC",))
    assert live is not None
    with pytest.raises(ConvergenceError, match=f"tendons.EDC.actuation: the piston was {words}"):
        step_cylinders(live, initial_air(live), 1e-3, np.array([inward]), 1e-3)


def test_what_a_case_says_reaches_the_cylinder_and_is_written_again(tmp_path: Path) -> None:
    said = (
        'voltage="9 V",supply="0.5 MPa",delay="20 ms",lag="2 ms",conductance="2 mm**3/s/Pa",'
        'critical_ratio=0.4,underlap=0.2,bore="12 mm",rod="4 mm",stroke="50 mm",start=0.2,'
        'dead_volume="3000 mm**3",friction="0.1 N",heat="0.3 W/K"'
    )
    signal = 'tendons.EDC.signal={kind="points",at=[["0 s",1.0],["0.1 s",2.0]]}'
    case = load_case("split_edc", ["forward={}", air(said), signal])
    live = cylinders(case.tendons, ("EDC",))
    assert live is not None
    valve, cylinder = live.air.valve, live.air.cylinder
    assert [float(np.asarray(x)[0]) for x in (
        valve.supply - ATMOSPHERE, valve.delay, valve.lag, valve.conductance, valve.critical_ratio,
        valve.underlap, cylinder.bore, cylinder.rod, cylinder.stroke, cylinder.dead_volume,
        cylinder.friction, cylinder.heat, live.initial_position,
    )] == pytest.approx(
        [5e5, 0.02, 2e-3, 2e-9, 0.4, 0.2, 12e-3, 4e-3, 0.05, 3e-6, 0.1, 0.3, 0.01]
    )  # fmt: skip
    assert live.command(0.0) == pytest.approx([9.0])
    assert live.command(0.1) == pytest.approx([10.0])  # no more than the valve's range
    assert live.voltages_at(0.01) == pytest.approx([9.0])
    assert live.voltages_at(0.025) == pytest.approx([9.45])
    path = tmp_path / "again.toml"
    path.write_text(resolved_toml(case))
    assert load_case(path).tendons == case.tendons


FAULTS: dict[str, tuple[tuple[str, ...], str]] = {
    "rest": ((air('voltage="5 V"'),), "air takes time to act, and an equilibrium has none"),
    "none": (("forward={}", 'tendons.EDC.actuation={kind="pneumatic"}'), "takes one command"),
    "both": (("forward={}", air('voltage="5 V",pressure="0.1 MPa"')), "takes one command"),
    "more": (("forward={}", air('pressure="0.7 MPa"')), "0.7 MPa is more than the supply's 0.6205"),
    "rod": (("forward={}", air('voltage="5 V",rod="10 mm"')), "thinner than its bore"),
    "unknown": (("forward={}", air('voltage="5 V"', "RI")), "have no such tendon"),
    "kind": (("forward={}", 'tendons.EDC.actuation={kind="oil"}'), "tendons.EDC.actuation.kind"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_cannot_be_is_refused(name: str) -> None:
    settings, words = FAULTS[name]
    told = [part for setting in (PLAIN, *settings) for part in ("--set", setting)]
    done = CliRunner().invoke(app, ["run", "split_edc", *told])
    assert done.exit_code == 2
    assert words in " ".join(done.stderr.split())


def test_two_ways_of_pulling_are_refused_in_one_file_and_replaced_by_a_later(
    tmp_path: Path,
) -> None:
    path = tmp_path / "two.toml"
    table = 'actuation = {kind = "pneumatic", voltage = "5 V"}'
    path.write_text(f'extends = "split_fdp"\n[forward]\n[tendons.EDC]\n{table}\ntension = "1 N"\n')
    with pytest.raises(InputError, match="gives actuation and tension; write one of them"):
        load_case(path)
    path.write_text(f'extends = "split_edc"\n[forward]\n[tendons.EDC]\n{table}\n')
    case: Any = load_case(path).tendons["EDC"]
    assert case.activation is None  # the file that it extends states one
    back = load_case(path, ["tendons.EDC.activation=0.1"]).tendons["EDC"]
    assert back.actuation is None
    other = load_case(path, ['tendons.EDC.actuation.pressure="0.1 MPa"']).tendons["EDC"].actuation
    assert other is not None
    assert (other.voltage, other.pressure) == (None, 1e5)
    shutil.rmtree(tmp_path)
