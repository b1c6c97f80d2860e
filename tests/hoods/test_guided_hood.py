"""What guides the hood: eyelets, sagittal bands, interosseous hood, and the heads that it rides on.

Accepted by anatomy: the straight lines between An's points (An et al. 1979, J Biomech 12:775)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.fingers.kinds import FINGERS, anatomy_of
from cosim.hoods.shell.build import _tendons
from cosim.hoods.shell.region_forces import STRIPS
from cosim.models.build import hood_mesh
from cosim.pipeline import run_case
from cosim.results.result import Result
from cosim.solve.session import Session
from meshes.bands import OVER_MCP
from meshes.glide import crossing, sheet_edges
from meshes.skeleton import index_finger
from rigid.fingers.index import INDEX, O2O3, ROWS

COARSE, FINER = "hood.mesh.quads=120", "hood.mesh.quads=250"
SHARED = Session(most=12)
PULL = 4.0
"""N, of one interosseous or the lumbrical alone."""
OVER = np.array([0.0, 15.0, 25.0, 36.0])
"""mm, stations at which the tendon's middle is looked at."""


@cache
def held(mcp: float, pip: float, dip: float, *tensions: str, mesh: str = COARSE) -> Result:
    angles = zip(("MCP", "PIP", "DIP"), (mcp, pip, dip), strict=True)
    posture = [f"finger.posture.{joint}={angle} deg" for joint, angle in angles]
    pulls = tensions or ("EDC.tension=0.05 N",)
    case = load_case("hood_rest", [mesh, *posture, *(f"tendons.{t}" for t in pulls)])
    return run_case(case, SHARED)


def pulled(tendon: str, mcp: float) -> Result:
    return held(mcp, 0, 0, "EDC.tension=0.05 N", f"{tendon}.tension={PULL} N")


def arm_of_line(tendon: str, mcp: float) -> float:
    """mm about the MCP, of the straight line between An's points of the tendon."""
    near, far = (np.array(p) for p in ROWS["MCP"][INDEX.intrinsic[tendon]])
    far = far + np.array([INDEX.offset["MCP"], 0, 0])
    turn = np.deg2rad(mcp)
    x, y = (
        far[0] * np.cos(turn) + far[1] * np.sin(turn),
        far[1] * np.cos(turn) - far[0] * np.sin(turn),
    )
    way = np.array([x, y]) - near[:2]
    return (
        1e3
        * O2O3
        * float(near[1] * way[0] - near[0] * way[1])
        / -np.linalg.norm([*way, far[2] - near[2]])
    )


def secant(result: Result, tendon: str, joint: str) -> float:
    """mm, torque over tension of the loaded less the unloaded hood."""
    now, before = result.summary, result.summary["unloaded"]
    torque = now["joint_torque_Nmm"]["hood"][joint] - before["joint_torque_Nmm"]["hood"][joint]
    return torque / (now["tension_N"][tendon] - before["tension_N"][tendon])


@pytest.mark.parametrize("tendon", INDEX.intrinsic)
@pytest.mark.parametrize("mcp", [0, 60, 80])
def test_an_intrinsics_arm_at_the_mcp_is_that_of_its_line(tendon, mcp):
    assert secant(pulled(tendon, mcp), tendon, "MCP") == pytest.approx(
        arm_of_line(tendon, mcp), abs=1.5
    )


@pytest.mark.parametrize("tendon", INDEX.intrinsic)
@pytest.mark.parametrize("mcp", [0, 60, 80])
def test_the_sheet_does_not_roll_round_the_phalanx(tendon, mcp):
    result = pulled(tendon, mcp)
    mesh = hood_mesh(load_case("hood_rest", [COARSE]))
    pairs = sheet_edges(mesh, OVER_MCP)
    skeleton = index_finger()
    position, rotation = skeleton.pose({"MCP": np.deg2rad(mcp)})
    place = result.data["node"].sel(state=["unloaded", "loaded"]).values
    for station in OVER:
        nodes, weight = crossing(mesh.station, pairs, station)
        sideways = ((weight @ place[:, nodes]) - position[1]) @ rotation[1][:, 1]
        assert abs(1e3 * np.diff(sideways)[0]) < 1.5, station


@pytest.mark.parametrize(("pip", "dip"), [(0, 0), (30, 0), (45, 15)])
def test_the_central_slip_comes_nearer_to_the_pip_as_it_flexes(pip, dip):
    arm = held(0, pip, dip, "EDC.tension=3.5 N").summary["strip_arm_mm"]["central_slip"]
    lines = {0: 5.3, 30: 4.9, 45: 4.4}
    assert arm == pytest.approx(lines[pip], abs=0.6)


def test_strips_and_their_arms_make_the_torque_of_the_pip():
    summary = held(0, 45, 15, "EDC.tension=3.5 N").summary
    arms, force = summary["strip_arm_mm"], summary["region_force_N"]
    over_pip = STRIPS["PIP"]
    assert set(arms) == {*over_pip, *STRIPS["DIP"]}
    torque = sum(arms[name] * force[name] for name in over_pip)
    assert torque == pytest.approx(-summary["joint_torque_Nmm"]["hood"]["PIP"], rel=0.15)


@pytest.mark.parametrize(("pip", "dip"), [(0, 0), (45, 15), (45, 45)])
def test_the_terminal_slip_s_arm_is_the_torque_of_the_dip_over_its_force(pip, dip):
    result = held(0, pip, dip, "EDC.tension=11.8 N")
    now, before = result.summary, result.summary["unloaded"]
    torque, rest = (s["joint_torque_Nmm"]["hood"]["DIP"] for s in (now, before))
    force = now["slip_force_N"]["terminal"] - before["slip_force_N"]["terminal"]
    assert now["strip_arm_mm"]["terminal_slip"] == pytest.approx((rest - torque) / force, rel=0.05)


def test_the_bands_stay_extensors_and_sink_under_load():
    straight, bent = (held(0, *p, "EDC.tension=3.5 N").summary for p in ((0, 0), (90, 45)))
    for side in ("radial", "ulnar"):
        assert bent["strip_arm_mm"][f"lateral_band_{side}"] > 0
        fall = straight["lateral_band_height_mm"][side] - bent["lateral_band_height_mm"][side]
        assert fall > 1.0


@pytest.mark.slow
def test_a_hood_at_rest_hardly_pulls_on_a_bent_finger():
    for posture in ((0, 45, 11), (80, 45, 31), (40, 90, 45)):
        torque = held(*posture, mesh=FINER).summary["unloaded"]["joint_torque_Nmm"]["hood"]
        assert max(abs(torque[j]) for j in ("MCP", "PIP", "DIP")) < 3, posture


def test_a_slack_strip_has_no_arm():
    summary = held(0, 60, 65, "EDC.tension=3.5 N").summary
    assert summary["slip_force_N"]["central"] < 0.02
    assert set(summary["strip_arm_mm"]) == {*STRIPS["PIP"], *STRIPS["DIP"]} - {"central_slip"}


def test_a_finger_of_any_size_has_its_eyelets_in_proportion():
    sizes = ["finger.length_scale=1.2", "finger.width_scale=1.1"]
    plain, larger = (
        FINGERS["index"].eyelets(load_case("hood_rest", s).finger) for s in ([], sizes)
    )
    for tendon, place in plain.items():
        assert larger[tendon] == pytest.approx(np.array(place) * [1.2, 1.1, 1.1])


def test_under_a_retinaculum_the_extensors_hang_on_ropes_and_pull_as_before():
    """A straight finger's: the rope runs along the metacarpal, as the line does."""
    held = [COARSE, "finger.tip.kind=posture", 'tendons.EDC.tension="4 N"', *STRAIGHT]
    line, rope = (
        run_case(load_case("isometric_edc", [*held, *more])).summary
        for more in ((), ('hood.retinaculum={proximal="70 mm"}',))
    )
    for slip, force in line["slip_force_N"].items():
        assert rope["slip_force_N"][slip] == pytest.approx(force, rel=0.05)
    pulls = [s["joint_torque_Nmm"]["hood"]["MCP"] for s in (line, rope)]
    assert pulls[1] == pytest.approx(pulls[0], rel=0.02)
    assert abs(rope["tendon_shift_mm"] - line["tendon_shift_mm"]) < 0.5


STRAIGHT = tuple(f'finger.posture.{joint}="0 deg"' for joint in ("MCP", "PIP", "DIP"))


def test_an_end_that_is_laid_beside_its_eyelet_slides_along_the_metacarpal():
    case = load_case("hood_rest", [COARSE])
    mesh, anatomy = hood_mesh(case), anatomy_of(case.finger, case.hood.left_to_finger)
    for beyond, hangs in ((5e-3, True), (3e-3, False)):
        points = mesh.points.copy()
        points[mesh.ends["ulnar"], 0] = anatomy.eyelets["FPI"][0] + beyond
        ends = _tendons(replace(mesh, points=points), anatomy)
        assert (ends["FPI"].eyelet is not None) == hangs
        assert ends["LUM"].eyelet is not None
