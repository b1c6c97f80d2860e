"""What a load changes beside what the hood has at rest, how far it has glided, and the warning."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.case.file import load_case
from cosim.cli import app
from cosim.models.build import build, hood_mesh
from cosim.port import STATIC, Array, Motion, rotation_matrix
from cosim.report.page import page
from cosim.report.tables import tables_of
from cosim.results.conventions import by_axis
from cosim.results.load_and_rest import (
    LEAST_RATIO,
    NO_TENDONS,
    NO_UNLOADED,
    NOT_PULLED,
    little_beyond_rest,
    rest_block,
    rest_warnings,
)
from cosim.results.read import read_runs
from meshes.cable_net import CableNet
from meshes.glide import PLACES, CarriedPoint, glide, net_places, sheet_places
from tests.helpers import shells
from tests.helpers.report_runs import run_into

QUICK = "output.picture=false"
COARSE = "hood.mesh.quads=120"


def state(
    tip: float, pip: float, terminal: float, tension: float, **others: float
) -> dict[str, Any]:
    """A state of a summary; `others`: torque about the PIP by its source."""
    return {
        "fingertip_force_N": by_axis((0.0, tip, 0.0)),
        "joint_torque_Nmm": {"hood": {"MCP": 0.0, "PIP": pip}}
        | {source: {"MCP": 0.0, "PIP": torque} for source, torque in others.items()},
        "slip_force_N": {"central": 0.0, "terminal": terminal},
        "tension_N": {"EDC": tension, "FDP": 9.0},
    }


REST = state(0.1, -5.0, 0.2, 0.05)
TIP, TORQUE, SLIP = "fingertip_force_N", "hood_torque_Nmm", "slip_force_N"


@pytest.mark.parametrize(
    ("loaded", "little"),
    [
        (state(0.4, -20.0, 0.8, 3.0), []),
        (state(0.4 - 1e-9, -20.0, 0.8, 3.0), [TIP]),
        (state(-0.19, -20.0, 0.8, 3.0), [TIP]),
        (state(-0.2, -20.0, 0.8, 3.0), []),
        (state(0.4, -19.9, 0.8, 3.0), [TORQUE]),
        (state(0.4, 9.9, 0.8, 3.0), [TORQUE]),
        (state(0.4, -20.0, 0.79, 3.0), [SLIP]),
        (state(0.1, -5.0, 0.2, 1.0), [TIP, TORQUE, SLIP]),
        (state(0.1, -5.0, 0.2, 0.99), []),
    ],
)
def test_a_load_that_adds_less_than_three_times_what_rest_has_is_warned_of(loaded, little):
    rest = rest_block(loaded, REST, ["EDC"])
    assert little_beyond_rest(rest) == little
    assert len(rest_warnings(rest, REST, is_laid=True)) == bool(little)


def test_figures_are_the_largest_at_rest_and_the_largest_change():
    rest = rest_block(state(-0.3, 4.0, 1.2, 3.0), REST, ["EDC"])
    assert rest[TIP] == pytest.approx({"at_rest": 0.1, "change": 0.4})
    assert rest[TORQUE] == pytest.approx({"at_rest": 5.0, "change": 9.0})
    assert rest[SLIP] == pytest.approx({"at_rest": 0.2, "change": 1.0})
    assert little_beyond_rest(rest) == [TORQUE]


@pytest.mark.parametrize(
    ("loaded", "tendons", "reason"),
    [
        (state(2.0, -5.0, 0.2, 0.9), ["EDC"], "bear 0.9 N under load, less than 1"),
        (state(2.0, -5.0, 0.2, 3.0), [], NO_TENDONS),
        (state(2.0, -5.0, 0.2, 0.05), ["EDC"], "bear 0.05 N"),
    ],
)
def test_a_load_that_does_not_act_through_the_hood_is_exempt_by_name(loaded, tendons, reason):
    rest = rest_block(loaded, REST, tendons)
    assert reason in rest["exempt"]
    assert rest[TORQUE]["at_rest"] == 5.0
    assert rest_warnings(rest, REST, is_laid=True) == []


def test_a_high_resting_tension_alone_is_no_load():
    tense = state(0.1, -5.0, 0.2, 4.0)
    assert rest_block(tense, tense, ["EDC"])["exempt"] == NOT_PULLED


def test_what_is_nowhere_is_not_told():
    rest = rest_block(state(0.0, 0.0, 0.5, 3.0), state(0.0, 0.0, 0.0, 0.05), ["EDC"])
    assert rest == {SLIP: {"at_rest": 0.0, "change": 0.5}}
    assert rest_warnings(rest, REST, is_laid=True) == []


@pytest.mark.parametrize(
    ("unloaded", "is_laid", "meaning"),
    [
        (state(0.1, -5.0, 0.0, 0.05, passive=1.0, fingertip=5.0), True, "laid free of stress"),
        (state(0.1, -5.0, 0.0, 0.05, passive=1.0), False, "free of tension"),
        (state(0.1, -5.0, 0.0, 0.05, passive=4.0, FDP=4.0), True, "passive joints"),
        ({"fingertip_force_N": by_axis((0, 0.1, 0)), "tension_N": {"EDC": 0.05}}, False, "FMU"),
    ],
)
def test_the_warning_says_what_pushes_at_rest(unloaded, is_laid, meaning):
    loaded = {**state(0.2, -50.0, 5.0, 3.0), "slip_force_N": {}}
    if "joint_torque_Nmm" not in unloaded:
        del loaded["joint_torque_Nmm"]
    rest = rest_block(loaded, {**unloaded, "slip_force_N": {}}, ["EDC"])
    (said,) = rest_warnings(rest, unloaded, is_laid)
    assert f"less than {LEAST_RATIO:g} times as much" in said
    assert "fingertip force 0.1 N at rest, largest change under load 0.1 N (1 times)" in said
    assert meaning in said


# --- glide


@pytest.fixture(scope="module")
def laid() -> tuple[tuple[CarriedPoint, ...], Array, Motion]:
    """Places of a coarse sheet, its points as laid and the bones' poses there."""
    hood = shells.index_hood(COARSE)
    mesh = hood_mesh(load_case("isometric_edc", [COARSE]))
    return sheet_places(mesh), hood.model.reference, hood.rest


def glide_to(
    places: tuple[CarriedPoint, ...], points: Array, rest: Motion, now: Array, at: Motion
) -> Any:
    was = (points, rest.position, rest.rotation)
    return glide(places, was, (now, at.position, at.rotation))


def test_a_hood_that_nothing_has_moved_has_not_glided(laid):
    places, points, rest = laid
    assert [place.name for place in places] == list(PLACES)
    assert glide_to(places, points, rest, points, rest) == dict.fromkeys(PLACES, 0.0)


def test_glide_is_how_far_distally_along_the_bone_beneath(laid):
    places, points, rest = laid
    for body, names in ((1, PLACES[:3]), (2, PLACES[3:])):
        _, radial, dorsal = rest.rotation[body].T
        way = 2e-3 * rest.rotation[body][:, 0] + 1e-3 * radial - 3e-3 * dorsal
        found = glide_to(places, points, rest, points + way, rest)
        assert [found[name] for name in names] == pytest.approx([2e-3] * len(names), abs=1e-12)


def test_glide_does_not_depend_on_where_the_hand_is(laid):
    places, points, rest = laid
    moved = points + 1e-3 * np.sin(1e3 * points)
    turn, shift = rotation_matrix(np.array([0.4, -1.1, 0.7])), np.array([0.3, -0.2, 0.1])
    hand = rest.transform(turn, shift)
    here = glide_to(places, points, rest, moved, rest)
    there = glide_to(places, points, rest, moved @ turn.T + shift, hand)
    assert max(map(abs, here.values())) > 1e-4
    assert there == pytest.approx(here, abs=1e-12)


def test_places_lie_where_they_are_said_to(laid):
    places, points, rest = laid
    where = {
        p.name: (p.weight @ points[p.nodes] - rest.position[p.body]) @ rest.rotation[p.body]
        for p in places
    }
    assert where["central_tendon"][0] == pytest.approx(21.3e-3, abs=1e-3)
    assert abs(where["central_tendon"][1]) < 1.5e-3
    for side, sign in (("radial", 1), ("ulnar", -1)):
        band = where[f"lateral_band_{side}"]
        assert band[0] == pytest.approx(42.6e-3, abs=4e-3)
        assert 4e-3 < sign * band[1] < 10e-3
    assert where["terminal_slip"][0] == pytest.approx(20.4e-3, abs=3e-3)
    for place in places:
        assert place.weight.sum() == pytest.approx(1)


def test_a_place_that_a_hood_lacks_is_left_out(laid):
    mesh = hood_mesh(load_case("isometric_edc", [COARSE]))
    kept = ~mesh.cells("terminal_slip", "lateral_band_ulnar")
    cut = replace(mesh, quads=mesh.quads[kept], region=mesh.region[kept])
    assert [place.name for place in sheet_places(cut)] == list(PLACES[:2])


def test_a_net_of_cables_has_the_same_places():
    net = CableNet(
        points=1e-3 * np.array([[0.0, 0, 0], [40.0, 0, 0], [45.0, 0, 0]]),
        cells=np.array([[0, 1], [1, 2]]),
        strand=np.array([0, 1]),
        strands=("central_band", "terminal_slip"),
        ends={},
        springs={},
        tied={},
        station=np.array([0.0, 40.0, 45.0]),
        rest_posture={},
    )
    central, terminal = net_places(net)
    at = np.zeros((4, 3)), np.tile(np.eye(3), (4, 1, 1))
    assert central.along(net.points, *at) == pytest.approx(42.59e-3 / 2)
    assert terminal.along(net.points, *at) == pytest.approx(40e-3)


def test_a_hood_where_it_was_laid_without_tension_is_at_rest():
    """With a smoothing of the contact that ends within the clearance at which the sheet is laid,
    and ligaments that are not as long as they are laid to the last bit."""
    posture = {"MCP": 20.0, "PIP": 40.0, "DIP": 11.0}
    same = [f'hood.mesh.rest_posture.{joint}="{angle} deg"' for joint, angle in posture.items()]
    more = [f'hood.extra_length.{slip}_slip="0 mm"' for slip in ("central", "terminal")]
    more += [f'hood.springs.retinacular_{side}.slack="0.1 mm"' for side in ("radial", "ulnar")]
    settings = [COARSE, *same, *more, 'hood.contact.smoothing="1 um"']
    models = build(load_case("isometric_edc", settings))
    hood, finger = models.hood, models.finger
    angles = {joint: float(np.deg2rad(angle)) for joint, angle in posture.items()}
    at = finger.start(angles)
    motion = finger.motion(at)
    response = hood.advance(hood.start(motion), motion, np.zeros(len(hood.tendons)), STATIC)
    assert models.built.view is not None
    assert models.built.slips is not None
    glided = models.built.view(response.state).glide
    assert list(glided) == list(PLACES)
    assert glided == pytest.approx(dict.fromkeys(PLACES, 0.0), abs=1e-12)
    torque = finger.jacobian(at).T @ response.load.total().ravel()
    assert torque == pytest.approx(np.zeros(len(torque)), abs=1e-10)
    slips = models.built.slips(response.state)
    assert slips == pytest.approx({"central": 0.0, "terminal": 0.0}, abs=1e-8)


# --- where it is told


def test_a_warning_is_told_after_the_table_and_near_the_top_of_the_report(tmp_path):
    run = partial(CliRunner().invoke, app)
    words = ["run", "planar_edc", "--set", QUICK, "--out", str(tmp_path)]
    done = run(words)
    assert done.exit_code == 0
    assert "WARNING: the load adds little to what is there at rest" in done.stderr
    assert "WARNING" in run([*words, "--quiet"]).stderr
    (report,) = runs = read_runs([tmp_path / "planar_edc"])
    (warning,) = report.summary["warnings"]
    assert warning in done.stderr
    text = page(runs, None, tables_of(runs, None))
    assert text.index("Warning: the load adds little") < text.index('id="question"')


def test_motions_say_that_they_have_no_unloaded_state(tmp_path):
    short = ("forward.must_rest=false", 'forward.duration="0.1 s"', QUICK)
    (run,) = runs = read_runs([run_into(tmp_path, "forward_edc", *short)])
    assert run.summary["rest"] == {"exempt": NO_UNLOADED}
    assert NO_UNLOADED in page(runs, None, tables_of(runs, None))


def test_a_fixed_split_is_exempt_by_name(tmp_path):
    (run,) = read_runs([run_into(tmp_path, "split_edc", QUICK)])
    assert run.summary["rest"]["exempt"] == NO_TENDONS
    assert run.summary["warnings"] == []
    assert "glide_mm" not in run.summary
