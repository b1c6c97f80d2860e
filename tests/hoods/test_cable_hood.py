"""The hood of cables on the index finger: its net, its forces, its case."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import InputError
from cosim.hoods.cable.build import cable_law
from cosim.hoods.cable.table import CableHoodConfig
from cosim.models.build import build
from cosim.port import STATIC, Motion
from cosim.report.views import view_of
from cosim.results.read import read_run
from fe_solver.hood.build import pulls_in
from fe_solver.hood.shell_hood import ShellHood
from meshes.cable_net import CABLES, CableNet, cable_of, lay
from meshes.hull import PIP
from meshes.skeleton import BODIES, index_finger
from tests.helpers import shells

EDC = np.array([11.8, 0.05, 0.05, 0.05])
FLEXED = {"MCP": np.deg2rad(30), "PIP": np.deg2rad(45), "DIP": np.deg2rad(15)}
PUBLISHED = {
    "central_band": 40.0,
    "central_slip": 3.0,
    "lateral_slip_radial": 38.0,
    "medial_slip_radial": 32.7,
    "terminal_slip": 10.0,
}
"""mm, of the network that the cables are laid after, on its longer finger (44.63 mm)."""


def pose(**angles: float) -> Motion:
    return Motion(BODIES, *index_finger().pose(angles))


@pytest.fixture(scope="module")
def net() -> CableNet:
    """Over cylinders and balls for bones: the net asks nothing more of them."""
    from cosim.fingers.kinds import skeleton_of
    from fe_solver.surfaces.shapes import Capsule

    case = load_case("cable_edc")
    skeleton = skeleton_of(case.finger)
    ends = [(-0.03, 0.0), *((0.0, length) for length in skeleton.length[1:])]
    bones = {
        body: Capsule(np.array([a, 0, 0]), np.array([b, 0, 0]), radius)
        for body, (a, b), radius in zip(BODIES, ends, (5e-3, 4e-3, 3e-3, 2e-3), strict=True)
    }
    height = dict.fromkeys(BODIES, 1.5e-3)
    return lay(skeleton, bones, height, dict.fromkeys(("MCP", "PIP", "DIP"), 0.0), 1.5e-3)


def test_the_net_has_every_cable_and_all_of_it_hangs_together(net: CableNet) -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    assert {cable_of(strand) for strand in net.strands} == set(CABLES)
    n = len(net.points)
    graph = coo_array((np.ones(len(net.cells)), tuple(net.cells.T)), shape=(n, n))
    assert connected_components(graph, directed=False)[0] == 1
    assert net.lengths().min() > 0.2e-3
    assert net.lengths().max() < 2.5e-3


def test_cables_are_as_long_as_the_published_ones(net: CableNet) -> None:
    laid = net.strand_lengths()
    for strand, length in PUBLISHED.items():
        assert 1e3 * laid[strand] == pytest.approx(length * PIP / 44.63, rel=0.1), strand


def test_both_sides_are_alike_on_bones_that_are(net: CableNet) -> None:
    laid = net.strand_lengths()
    for strand in ("lateral_band", "lateral_slip", "medial_slip", "hood_edge", "sagittal_band"):
        assert laid[f"{strand}_radial"] == pytest.approx(laid[f"{strand}_ulnar"], rel=1e-2)


def slips(hood: ShellHood, motion: Motion) -> tuple[float, float]:
    """N in the central and in the terminal slip under EDC's 11.8 N."""
    state = hood.advance(hood.start(motion), motion, EDC, STATIC).state
    force = hood.group_forces(state)
    central, terminal = (float(np.linalg.norm(force[f"{s}_slip"])) for s in ("central", "terminal"))
    return central, terminal


def test_slips_share_what_the_tendon_pulls() -> None:
    """At the straight finger both slips bear, and sagittal bands little."""
    central, terminal = slips(shells.cable_hood(), pose())
    assert 0.7 < terminal / central < 2.0
    assert central + terminal == pytest.approx(11.8, rel=0.1)
    longer = shells.cable_hood('hood.cables.terminal_slip.extra_length="1 mm"')
    assert slips(longer, pose())[1] < terminal / 1.3


def test_no_cable_pushes() -> None:
    hood = shells.cable_hood()
    state = hood.advance(hood.start(pose()), pose(**FLEXED), EDC, STATIC).state
    pull, residual = pulls_in(hood, state), hood.model.cables.residual
    assert (pull.force > 0).all()
    assert (pull.strain < -0.05).any()
    assert (pull.force[pull.strain < 0] < residual[pull.strain < 0]).all()


def test_the_residual_tension_hardly_shares_the_load() -> None:
    """Halved, it moves the slips' forces under 11.8 N by hundredths of a newton."""
    halved = shells.cable_hood('hood.residual_tension="0.01 N"')
    there = pose(**FLEXED)
    change = np.subtract(slips(shells.cable_hood(), there), slips(halved, there))
    assert 1e-4 < np.abs(change).max() < 0.15


def test_moment_arms_by_force_and_by_excursion_are_one() -> None:
    hood = shells.cable_hood()
    state = hood.advance(hood.start(pose()), pose(**FLEXED), EDC, STATIC).state
    J = hood.jacobian(state)
    force, slide = J.load_tension[6:], J.excursion_motion[:, 6:].T
    assert np.abs(force - slide).max() < 1e-8 * np.abs(slide).max()


@pytest.mark.slow
def test_a_way_over_softer_contact_ends_where_the_straight_one_does() -> None:
    """And sooner, taken together: which way is the shorter hangs on the posture."""
    hood, spent = shells.cable_hood(), np.zeros(2)
    ways = hood, replace(hood, softer=1.0)
    for angles in ({}, FLEXED | {"MCP": 0.0}, FLEXED):
        there = pose(**angles)
        led, straight = (h.advance(h.start(there), there, EDC, STATIC) for h in ways)
        assert led.load.wrench == pytest.approx(straight.load.wrench, abs=1e-7)
        spent += led.state.iterations, straight.state.iterations
    assert spent[0] < spent[1]


def test_a_case_runs_and_passes_its_audits(tmp_path: Path) -> None:
    args = ["run", "cable_edc", "--set", shells.COARSE_NET, "--set", "output.picture=false"]
    answer = CliRunner().invoke(app, [*args, "--out", str(tmp_path)])
    assert answer.exit_code == 0, answer.output
    folder = tmp_path / "cable_edc"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["audit_missed"] == []
    assert summary["audit"]["reciprocity"] < 1e-4
    arms = summary["difference"]["moment_arm_mm"]["EDC"]
    assert -11 < arms["MCP"] < -7
    assert -6 < arms["PIP"] < -3
    assert -4 < arms["DIP"] < -0.5
    terminal = summary["cable"]["terminal_slip"]["tension_N"]
    assert terminal == pytest.approx(summary["slip_force_N"]["terminal"], rel=0.05)
    lines = meshio.read(folder / "hood.vtu")
    assert lines.cells[0].type == "line"
    with xarray.open_dataset(folder / "results.nc") as data:
        assert data.cable_tension.sizes == {"state": 2, "cell": summary["hood_cells"]}
        tension = data.cable_tension.sel(state="loaded")
        slip = float(tension[data.strand.values == "terminal_slip"].max())
        assert slip == pytest.approx(terminal)
    view = view_of(read_run(folder))
    assert view.sheet is None
    assert view.net is not None
    assert len(view.net.cells) == len(view.net.names) == summary["hood_cells"]
    by_key = {field.key: field.values[-1] for field in view.fields}
    assert by_key["cable_tension"] == pytest.approx(tension.values)


def test_a_result_says_which_retry_led_there() -> None:
    models = build(load_case("cable_edc", ['hood.mesh.spacing="3 mm"']))
    motion = models.finger.motion(models.finger.start(models.posture))
    state = models.hood.advance(models.hood.start(motion), motion, EDC, STATIC).state
    assert state.attempt == "at once"
    assert models.built.view is not None
    assert "hood_solved" not in models.built.view(state).summary()
    halved = models.built.view(replace(state, attempt="in halves")).summary()
    assert halved["hood_solved"] == "in halves"


def test_a_picture_draws_line_cells() -> None:
    from cosim.hoods.view import STRAIN, HoodField
    from cosim.results.parts import Scene
    from cosim.results.scene_plot import draw

    line = np.array([[0.0, 0, 0], [1e-3, 0, 0], [2e-3, 1e-3, 0]])
    field = HoodField(line, np.array([[0, 1], [1, 2]]), {}, {STRAIN: np.array([0.0, 0.02])})
    figure = draw(Scene(field, (), (), None), "two cells")
    drawn = figure.axes[1].collections[0].get_paths()
    assert len(drawn) == 2
    assert np.ptp(drawn[0].vertices, axis=0).max() == pytest.approx(1.0, abs=0.8)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ('hood.cables.sagital_band={section="1 mm**2", modulus="1 MPa"}', "sagittal_band"),
        ('hood.cables.terminal_slip.section="0 mm**2"', "terminal_slip.section"),
        ("hood.toe=0.0", "hood.toe"),
        ('hood.residual_tension="0 N"', "hood.residual_tension"),
    ],
)
def test_a_faulty_case_says_where(setting: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_case("cable_edc", [setting])


def test_a_cable_that_would_have_no_length_is_refused(net: CableNet) -> None:
    small = replace(net, points=0.9 * net.points)
    hood = load_case("cable_edc", ['hood.cables.central_slip.extra_length="-3 mm"']).hood
    assert isinstance(hood, CableHoodConfig)
    with pytest.raises(InputError, match=r"central_slip\.extra_length: leaves nothing"):
        cable_law(hood, small)


@pytest.mark.parametrize("ending", [".json", ".feb"])
def test_what_cables_are_not_is_refused(ending: str, tmp_path: Path) -> None:
    target = str(tmp_path / f"hood{ending}")
    answer = CliRunner().invoke(app, ["export", "cable_edc", "--out", target])
    assert answer.exit_code == 2
    assert "cables" in answer.output
    assert not Path(target).exists()
