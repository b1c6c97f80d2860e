"""The middle finger's hood: laid by the index finger's generator on the middle finger's model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.fingers.kinds import FINGERS, skeleton_of
from cosim.models.build import Models, bone_surfaces, build, hood_mesh
from cosim.pipeline import run_case
from cosim.results.compare import Target, compare_with_targets, read_targets
from cosim.results.conventions import vector_of
from meshes.bones import bone_surface
from meshes.hood_mesh import HoodMesh
from meshes.hull import DIP, PIP, Centreline, Hull, Level, along
from meshes.skeleton import BODIES, index_finger, myohand_finger
from rigid.fingers import middle as middle_finger
from tests.helpers.folders import CASE_DATA
from tests.proofs.fingers.finger_rows import SINGLE_TENDON

WIDER = 23.63 / 20
POSTURES = {"minorflex": (40, 55, 35), "majorflex": (55, 57, 25)}
MUSCLES = ("edc", "lum", "ri", "ui", "fdp", "fds")
COARSE = "hood.mesh.quads=250"


def case(*settings: str, name: str = "hood_minorflex_edc") -> Case:
    return load_case(name, [COARSE, *settings])


width = FINGERS["middle"].width


@cache
def build_with(*settings: str) -> tuple[Models, HoodMesh]:
    return build(case(*settings)), hood_mesh(case(*settings))


# Stations -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [1.0, 0.8, 1.7])
def test_stations_of_an_index_finger_of_any_size_are_scaled_and_no_more(factor):
    station = np.array([-20.0, 0.0, 12.3, PIP, 55.0, DIP, 73.0])
    skeleton = index_finger().scale(factor)
    plain = station * 1e-3 * (skeleton.length[1] / (PIP * 1e-3))
    np.testing.assert_allclose(along(skeleton, station), plain, rtol=1e-15)
    if factor == 1.0:
        assert np.array_equal(along(skeleton, station), plain)


def test_stations_of_joints_are_at_the_middle_fingers_joints():
    skeleton = middle_finger.skeleton()
    proximal, middle, distal = skeleton.length[1:]
    place = along(skeleton, np.array([0.0, PIP, DIP]))
    np.testing.assert_allclose(place, [0.0, proximal, proximal + middle], atol=1e-5)
    beyond = along(skeleton, np.array([DIP + 5])) - place[-1]
    assert beyond == pytest.approx(5e-3 * distal / index_finger().length[3], rel=1e-3)
    before = along(skeleton, np.array([-20.0]))
    assert before == pytest.approx(-20e-3 * proximal / index_finger().length[1], rel=1e-3)


@dataclass(frozen=True)
class Cone:
    """About the straight finger, 0.06 mm thinner with every mm; `start`: of the body, m."""

    start: float

    def distance(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        across = np.hypot(points[:, 1], points[:, 2])
        value = across - radius_of_cone(points[:, 0] + self.start)
        gradient = np.column_stack([np.full(len(points), 0.06), *(points[:, 1:].T / across)])
        return value, gradient, np.zeros((len(points), 3, 3))


def radius_of_cone(place: np.ndarray) -> np.ndarray:
    return 0.010 - 0.06 * place


def test_the_hull_reaches_as_far_as_the_longer_fingers_hood():
    skeleton = middle_finger.skeleton()
    position, rotation = skeleton.pose({})
    cones = {body: Cone(x) for body, x in zip(BODIES, position[:, 0], strict=True)}
    level = Level(cones, dict.fromkeys(BODIES, 0.0), position, rotation)
    station = np.array([-20.0, 30.0, 73.0])
    points = Hull(Centreline(skeleton, position, rotation), level).points(station, np.zeros(3))
    np.testing.assert_allclose(points[:, 0], along(skeleton, station), atol=1e-12)
    np.testing.assert_allclose(points[:, 2], radius_of_cone(points[:, 0]), atol=0.1e-3)


# Bones and mesh -----------------------------------------------------------------------------------


def test_each_bone_is_its_own_as_long_as_its_phalanx_and_as_wide_as_measured():
    laid, lengths = bone_surfaces(case()), middle_finger.skeleton().length[1:]
    longer = lengths / myohand_finger("middle").length[1:]
    assert longer == pytest.approx([1.052, 0.989, 0.994], abs=1e-3)
    assert width(case().finger) == pytest.approx(WIDER)
    for body, factor in zip(BODIES, [longer.mean(), *longer], strict=True):
        size = [
            np.ptp(points, axis=0)
            for points, _ in (laid[body], bone_surface(body, finger="middle"))
        ]
        np.testing.assert_allclose(size[0] / size[1], [factor, 1, 1], rtol=8e-3)


def test_the_hoods_skeleton_is_the_rigid_models():
    """Bodies of both stand alike in any posture, or the hood would be coupled to other bones."""
    models, _ = build_with()
    angles = {"MCP": 0.7, "MCP_abduction": 0.2, "PIP": 0.9, "DIP": 0.4}
    motion = models.finger.motion(models.finger.start(angles))
    position, rotation = skeleton_of(case().finger).pose(angles)
    np.testing.assert_allclose(motion.position, position, atol=1e-12)
    np.testing.assert_allclose(motion.rotation, rotation, atol=1e-12)


def test_the_sheet_lies_on_the_longer_bones_from_end_to_end():
    models, mesh = build_with()
    model, rest = models.hood.model, models.hood.rest
    gap = models.hood.gap(models.hood.start(rest))
    assert gap.min() > -0.4e-3  # between so few nodes the sheet sags
    for contact in model.contacts:
        own = replace(
            contact, nodes=np.arange(len(gap)), offset=contact.offset.min(), within=None, layer=None
        )
        assert own.gap(model.reference, rest.position, rest.rotation).min() > 0
    assert np.median(gap[np.isfinite(gap)]) < 1.5e-3
    lengths = middle_finger.skeleton().length
    terminal = mesh.points[mesh.tied["distal"], 0]
    beyond = 1e-3 * (73.0 - DIP) * lengths[3] / index_finger().length[3]
    np.testing.assert_allclose(terminal, lengths[1] + lengths[2] + beyond, atol=0.1e-3)
    slip = mesh.springs["central_slip"]
    assert slip.body == "middle"
    assert 0 < slip.anchors[:, 0].min() < slip.anchors[:, 0].max() < lengths[2] / 2
    assert mesh.reach == pytest.approx(lengths[1])


def test_intrinsic_tendons_run_through_the_third_digits_points():
    models, _ = build_with()
    hood, rows = models.hood, middle_finger.record().rows["MCP"]
    ropes = hood.model.ropes
    for tendon, row in (("LUM", "LU"), ("RI", "RI"), ("UI", "UI")):
        x, dorsal, beside = np.array(rows[row][0]) * middle_finger.O2O3
        own = ropes.share[hood.tendons.index(tendon)] > 0
        np.testing.assert_allclose(ropes.eyelet[own], [[x, beside, dorsal]] * own.sum(), atol=1e-7)
        assert (ropes.length[own] > 5e-3).all()


def test_a_scaled_finger_scales_all_that_its_hood_is_laid_by():
    plain, scaled = case().finger, case("finger.length_scale=1.1").finger
    assert width(scaled) == pytest.approx(1.1 * width(plain))
    np.testing.assert_allclose(skeleton_of(scaled).length, 1.1 * skeleton_of(plain).length)
    large, small = FINGERS["middle"].eyelets(scaled), FINGERS["middle"].eyelets(plain)
    for tendon in small:
        np.testing.assert_allclose(large[tendon], 1.1 * np.array(small[tendon]))
    bones = bone_surfaces(case("finger.length_scale=1.1"))["proximal"][0]
    size = np.ptp(bones, axis=0) / np.ptp(bone_surfaces(case())["proximal"][0], axis=0)
    np.testing.assert_allclose(size, 1.1, rtol=3e-3)


def test_an_index_hood_does_not_go_on_it(tmp_path):
    from meshes.hood_mesh import write

    path = tmp_path / "index.json"
    write(hood_mesh(load_case("isometric_edc", [COARSE])), path)
    taken = load_case("hood_minorflex_edc", [f"hood.mesh={{kind='file', path='{path}'}}"])
    with pytest.raises(InputError, match=r"laid on a finger of 42\.59 mm.*47\.02"):
        hood_mesh(taken)


# Tendons ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("elements", ["linear", "quadratic"])
def test_who_pulls_where(elements):
    models, mesh = build_with("hood.mesh.quads=600", f'hood.mesh.elements="{elements}"')
    assert models.hood.tendons == ("EDC", "LUM", "RI", "UI")
    assert models.finger.tendons == ("RIp", "FDP", "FDS")
    model, ropes = models.hood.model, models.hood.model.ropes
    node = np.concatenate([model.guides.node, ropes.node])
    share = np.hstack([model.share, ropes.share])
    for row, end in zip(share, ("central", "radial", "radial", "ulnar"), strict=True):
        assert row.sum() == pytest.approx(1)
        assert set(node[row > 0]) <= set(mesh.ends[end])
    lumbrical, interosseous = share[1:3]
    assert (interosseous - lumbrical) @ mesh.points[node, 2] > 0.5e-3, "the lumbrical is palmar"
    ends = mesh.ends["radial"]
    on_end = np.array([[row[node == n].sum() for n in ends] for row in (lumbrical, interosseous)])
    if elements == "linear":
        both = np.sort(on_end.sum(axis=0))
        np.testing.assert_allclose(both, [0.5, 0.5, 1.0], atol=1e-12)
    x = mesh.points[ends]
    along = np.linalg.norm(x - x[0], axis=1) / np.linalg.norm(x[-1] - x[0])
    np.testing.assert_allclose(sorted(on_end @ along), [0.25, 0.75], atol=0.02)  # half of the width


def test_half_of_the_radial_interosseous_ends_on_the_proximal_phalanx():
    for posture in POSTURES:
        split = load_case(f"middle_{posture}_ri").tendons["RI"].tension
        hooded = load_case(f"hood_{posture}_ri").tendons
        assert hooded["RI"].tension + hooded["RIp"].tension == pytest.approx(split)
        assert hooded["RIp"].tension == pytest.approx(middle_finger.MIDDLE.to_bone["RI"] * split)


# Cases and targets --------------------------------------------------------------------------------


@pytest.mark.parametrize("muscle", MUSCLES)
@pytest.mark.parametrize("posture", POSTURES)
def test_a_case_differs_from_the_fixed_splits_in_the_hood_alone(posture, muscle):
    hooded, split = (load_case(f"{kind}_{posture}_{muscle}") for kind in ("hood", "middle"))
    assert hooded.finger.kind == split.finger.kind == "middle"
    assert hooded.finger.tip == split.finger.tip
    assert hooded.finger.posture == split.finger.posture
    angles = hooded.finger.posture
    assert np.rad2deg([angles.MCP, angles.PIP, angles.DIP]) == pytest.approx(POSTURES[posture])
    pulled = {n: t.tension for n, t in hooded.tendons.items() if t.tension and n != "RIp"}
    assert set(pulled) == set(split.tendons) == {muscle.upper()}


def test_the_hood_is_the_index_fingers_scaled_by_o2o3():
    middle, index = case().hood, load_case("base/index_finger.toml").hood
    for name, region in middle.regions.items():
        own = index.regions[name]
        if own.section is not None:
            assert region.section == pytest.approx(WIDER * own.section, rel=3e-3)
        assert region.model_copy(update={"section": own.section}) == own
    assert middle.thickness == index.thickness
    assert middle.mesh.rest_posture == index.mesh.rest_posture
    extra = middle.extra_length.central_slip / index.extra_length.central_slip
    assert middle.extra_length.terminal_slip == index.extra_length.terminal_slip == 0
    assert extra == pytest.approx(WIDER, rel=3e-3)
    for name, spring in middle.springs.items():
        assert spring.stiffness == index.springs[name].stiffness
        assert spring.slack == pytest.approx(WIDER * index.springs[name].slack, rel=3e-3, abs=1e-9)


def test_the_terminal_slip_lies_on_the_bone_as_the_index_fingers_does():
    ours, index = case().hood.contact.offset, load_case("isometric_edc").hood.contact.offset
    assert (ours.middle, ours.distal) == (index.middle, index.distal)


def targets(name: str) -> tuple[Target, ...]:
    return read_targets(CASE_DATA / f"synek2019_{name}.csv")


def test_hood_and_split_are_compared_with_the_same_numbers():
    means = targets("fingertip")
    hooded, split = (
        {(t.case.removeprefix(kind), t.quantity): t for t in means if t.case.startswith(kind)}
        for kind in ("hood", "middle")
    )
    cases = {f"_{posture}_{muscle}" for posture in POSTURES for muscle in MUSCLES}
    assert {case for case, _ in hooded} == {case for case, _ in split} == cases
    assert len(hooded) == len(split) == 4 * len(cases) == len(means) / 2
    for key, target in hooded.items():
        assert (target.reference, target.sd) == (split[key].reference, split[key].sd)
        assert not target.fitted


def test_the_hands_means_and_deviations_are_those_of_the_hands():
    hands = targets("specimens")
    for mean in targets("fingertip"):
        if mean.quantity.endswith("magnitude_N"):
            force = [t for t in hands if t.case == mean.case]
            numbers = np.linalg.norm(np.reshape([t.reference for t in force], (3, 3)), axis=0)
        else:
            numbers = np.array(
                [t.reference for t in hands if (t.case, t.quantity) == (mean.case, mean.quantity)]
            )
        assert len(numbers) == 3
        assert numbers.mean() == pytest.approx(mean.reference, abs=2e-3)
        assert numbers.std(ddof=1) == pytest.approx(mean.sd, abs=2e-3)


def test_targets_are_the_verifications_with_the_signs_of_a_summary():
    means = {(t.case, t.quantity.split(".")[-1]): t.reference for t in targets("fingertip")}
    for angles, muscle, _, force, _ in SINGLE_TENDON:
        name = next(n for n, p in POSTURES.items() if p == angles)
        row = [means[f"hood_{name}_{muscle.lower()}", a] for a in ("distal", "palmar", "radial")]
        np.testing.assert_allclose(row, np.multiply(force, [-1, -1, 1]), atol=6e-4)


def test_a_summary_says_the_change_of_force_in_the_phalanx():
    """Of a fixed split, which has no force unloaded; the phalanx is turned by all three joints."""
    summary = run_case(load_case("middle_minorflex_ui")).summary
    change = summary["difference"]
    along, radial, dorsal = vector_of(change["fingertip_force_N"])
    bend = np.radians(sum(POSTURES["minorflex"]))
    c, s = np.cos(bend), np.sin(bend)
    expected = [c * along - s * dorsal, radial, s * along + c * dorsal]
    in_phalanx = vector_of(change["fingertip_force_in_phalanx_N"])
    np.testing.assert_allclose(in_phalanx, expected, atol=1e-12)
    rows = compare_with_targets(targets("fingertip"), summary, "middle_minorflex_ui")
    distal, radial, dorsal = in_phalanx
    assert [row.model for row in rows][:3] == [distal, -dorsal, radial]


@pytest.mark.slow
def test_the_coupled_hood_agrees_with_the_finger():
    """Balanced, in the posture that the clamp holds, and with signs that the muscle has."""
    bent = (f"finger.posture.{j}={a} deg" for j, a in (("MCP", 30), ("PIP", 30), ("DIP", 15)))
    summary = run_case(case(*bent, "tendons.UI.tension=1 N", name="hood_minorflex_ui")).summary
    assert summary["audit_missed"] == []
    assert summary["posture_deg"]["PIP"] == pytest.approx(30)
    arms = summary["moment_arm_mm"]["UI"]
    assert arms["MCP"] > 0 > max(arms["PIP"], arms["DIP"])
    assert arms["MCP_abduction"] < 0
    assert 0.1 < summary["difference"]["fingertip_magnitude_N"] < 1, "no more than the tendon pulls"
