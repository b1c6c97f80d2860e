"""Hoods of the ring and the little finger, and what the middle finger's shares with them: laid by
the index finger's generator on bones of their own, by one set of rules."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.case.file import load_case, packaged_cases
from cosim.case.schema import Case
from cosim.fingers.kinds import FINGERS, skeleton_of
from cosim.hoods.shell.build import thickness_of
from cosim.models.build import bone_surfaces, build, hood_mesh
from cosim.pipeline import run_case
from meshes.skeleton import BODIES, myohand_finger
from rigid.fingers.little import LITTLE
from rigid.fingers.middle import MIDDLE
from rigid.fingers.ring import RING

COARSE = "hood.mesh.quads=150"
RECORDS = {"ring": RING, "little": LITTLE}
MIDDLE_TOO = {"middle": MIDDLE, **RECORDS}
# mm, bare bone over the MCP's and the PIP's axis (mean over 4 mm).
BARE = {"middle": (5.2, 3.0), "ring": (4.9, 2.8), "little": (5.1, 2.7)}


def case(kind: str, *settings: str) -> Case:
    return load_case(f"base/{kind}_hood.toml", [COARSE, *settings])


@pytest.mark.parametrize("kind", RECORDS)
def test_a_hood_is_the_index_fingers_scaled_by_o2o3(kind: str) -> None:
    hood, index = case(kind).hood, load_case("base/index_finger.toml", [COARSE]).hood
    larger = FINGERS[kind].width(case(kind).finger)
    assert larger == pytest.approx(RECORDS[kind].o2o3 / 0.02)
    for name, region in hood.regions.items():
        base = index.regions[name]
        if base.section is not None:
            assert region.section == pytest.approx(larger * base.section, abs=0.006e-6)
        assert region.model_copy(update={"section": base.section}) == base
    assert hood.extra_length.central_slip == pytest.approx(0.3e-3 * larger, abs=1e-6)
    for name, spring in hood.springs.items():
        assert spring.stiffness == index.springs[name].stiffness
        expected = larger * index.springs[name].slack
        assert spring.slack == pytest.approx(expected, rel=0.01, abs=1e-9)


@pytest.mark.parametrize(
    ("joint", "row", "body", "part"),
    [
        ("MCP", "LE", "metacarpal", "extensor_tendon_distal"),
        ("PIP", "ES", "proximal", "central_slip"),
    ],
)
@pytest.mark.parametrize("kind", MIDDLE_TOO)
def test_contact_offsets_put_the_sheet_at_ans_heights(
    kind: str, joint: str, row: str, body: str, part: str
) -> None:
    laid, record = case(kind), MIDDLE_TOO[kind]
    bones, skeleton = bone_surfaces(laid)[body][0], skeleton_of(laid.finger)
    at = 0.0 if body == "metacarpal" else skeleton.length[1]
    near = bones[(np.abs(bones[:, 0] - at) < 0.4e-3) & (np.abs(bones[:, 1]) < 2e-3)]
    bare = BARE[kind][joint == "PIP"]
    assert 1e3 * near[near[:, 2] > 0, 2].mean() == pytest.approx(bare, abs=0.2)
    mesh = hood_mesh(laid)
    thickness = thickness_of(laid.hood, mesh)[mesh.cells(part)].mean()
    height = 1e3 * (getattr(laid.hood.contact.offset, body) + thickness / 2) + bare
    lower = 0.4 if joint == "PIP" else 0.0  # as on the other fingers
    assert height == pytest.approx(
        1e3 * record.o2o3 * record.rows[joint][row][0][1] - lower, abs=0.06
    )


@pytest.mark.parametrize("kind", RECORDS)
def test_bodies_of_hood_and_finger_stand_alike_and_the_sheet_lies_on_the_bones(kind: str) -> None:
    models = build(case(kind))
    angles = {"MCP": 0.7, "MCP_abduction": 0.2, "PIP": 0.9, "DIP": 0.4}
    motion = models.finger.motion(models.finger.start(angles))
    position, rotation = myohand_finger(kind).pose(angles)
    np.testing.assert_allclose(motion.position, position, atol=1e-12)
    np.testing.assert_allclose(motion.rotation, rotation, atol=1e-12)
    gap = models.hood.gap(models.hood.start(models.hood.rest))
    assert gap.min() > -0.7e-3  # between so few nodes the sheet sags
    assert np.median(gap[np.isfinite(gap)]) < 1.5e-3


def test_who_pulls_where_on_the_little_finger() -> None:
    """EDM at the ulnar half of the extensor's end, ADM at the ulnar side, through An's points."""
    models, mesh = build(case("little")), hood_mesh(case("little"))
    assert models.hood.tendons == ("EDC", "EDM", "LUM", "RI", "ADM")
    assert models.finger.tendons == ("ADMp", "FDP", "FDS")
    model, ropes = models.hood.model, models.hood.model.ropes
    node = np.concatenate([model.guides.node, ropes.node])
    share = np.hstack([model.share, ropes.share])
    for row, end in zip(share, ("central", "central", "radial", "radial", "ulnar"), strict=True):
        assert row.sum() == pytest.approx(1)
        assert set(node[row > 0]) <= set(mesh.ends[end])
    whole, ulnar = share[:2] @ mesh.points[node, 1]
    assert ulnar < whole - 0.5e-3
    for tendon, row in LITTLE.intrinsic.items():
        x, dorsal, beside = np.array(LITTLE.rows["MCP"][row][0]) * LITTLE.o2o3
        on_rope = ropes.share[models.hood.tendons.index(tendon)] > 0
        expected = [[x, beside, dorsal]] * on_rope.sum()
        np.testing.assert_allclose(ropes.eyelet[on_rope], expected, atol=1e-7)


@pytest.mark.parametrize("kind", RECORDS)
def test_a_scaled_finger_scales_all_of_its_bones(kind: str) -> None:
    plain, scaled = (bone_surfaces(case(kind, f"finger.length_scale={s}")) for s in (1.0, 1.1))
    for body in BODIES:
        size = np.ptp(scaled[body][0], axis=0) / np.ptp(plain[body][0], axis=0)
        np.testing.assert_allclose(size, 1.1, rtol=0.03)  # edges of one length on both


@pytest.mark.parametrize("kind", RECORDS)
def test_a_hood_on_the_finger_balances_and_is_quiet_at_rest(kind: str) -> None:
    """And the arms of its extensor are within 2 mm of those of its tendons by fixed shares."""
    result = run_case(load_case(f"{kind}_edc", [COARSE, "output.picture=false"]))
    assert result.audit.passed
    assert result.summary["audit_missed"] == []
    assert result.summary["unloaded"]["fingertip_magnitude_N"] < 0.2
    arms = result.summary["moment_arm_mm"]["EDC"]
    split = run_case(load_case("split_edc", [f"finger.kind={kind}"])).summary["moment_arm_mm"]
    for joint in ("MCP", "PIP", "DIP"):
        assert arms[joint] == pytest.approx(split["EDC"][joint], abs=2.0)
        assert arms[joint] < 0


def test_each_finger_has_its_cases() -> None:
    names = set(packaged_cases())
    for kind, muscles in (("ring", "edc lum ui fdp"), ("little", "edc edm adm fdp")):
        assert {name for name in names if name.startswith(f"{kind}_")} == {
            f"{kind}_{muscle}" for muscle in muscles.split()
        }
