"""Cuts, adhesions and shortenings of a hood's mesh and net: what is left holds together."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.hoods.cable.table import PARTS as OF_CABLES
from cosim.hoods.fe_supports import STRUT, adhesions
from cosim.hoods.lesion import LesionConfig, apply_lesion_to_mesh, apply_lesion_to_net
from cosim.hoods.shell.build import growth_of, thickness_of
from cosim.hoods.shell.table import PARTS as OF_SHELL
from cosim.models.build import build, hood_mesh
from cosim.port import Motion
from fe_solver.forces.springs import spring_forces
from fe_solver.supports import springs_of
from meshes.cable_net import CableNet
from meshes.hood_lines import JOIN
from meshes.hood_mesh import REGIONS, Attachment, HoodMesh
from meshes.severed import PLACES, cut_net, cut_part, cut_part_of

COARSE = "hood.mesh.quads=250"
SPACED = 'hood.mesh.spacing="3 mm"'
LENGTHENED = ("central_slip", "extensor_tendon_distal", "lateral_band_radial", "central_band")


@cache
def intact() -> HoodMesh:
    return hood_mesh(load_case("lesion_mallet", [COARSE]))


@cache
def net() -> CableNet:
    from cosim.fingers.kinds import anatomy_of
    from cosim.hoods.cable.build import build_net

    case = load_case("cable_edc", [SPACED])
    return build_net(case.hood, anatomy_of(case.finger, case.hood.left_to_finger))


# Cuts of a mesh


def whole(mesh: HoodMesh) -> None:
    """Every node belongs to a quad, every set to a node, and the file's reader would take it."""
    assert np.array_equal(np.unique(mesh.quads), np.arange(len(mesh.points)))
    assert len(mesh.station) == len(mesh.points)
    assert len(mesh.region) == len(mesh.fibre) == len(mesh.quads)
    for nodes in (
        *mesh.ends.values(),
        *mesh.tied.values(),
        *(s.nodes for s in mesh.springs.values()),
    ):
        assert np.all(nodes < len(mesh.points))


@pytest.mark.parametrize("part", OF_SHELL.cut)
def test_every_part_can_be_cut_and_leaves_a_whole_mesh(part):
    before, after = intact(), cut_part(intact(), part)
    whole(after)
    lost = len(before.quads) - len(after.quads)
    released = sum(map(len, before.tied.values())) - sum(map(len, after.tied.values()))
    sets = len(before.springs) - len(after.springs)
    kinds = 2 if part.startswith("sagittal_band") else 1  # its springs and its sheet
    assert [lost > 0, released > 0, sets > 0].count(True) == kinds
    assert all(
        np.array_equal(before.points[before.ends[e]], after.points[after.ends[e]])
        for e in before.ends
    )


def test_a_slip_comes_off_its_own_bone_alone():
    central, terminal = cut_part(intact(), "central_slip"), cut_part(intact(), "terminal_slip")
    assert set(intact().springs) - set(central.springs) == {"central_slip"}
    assert np.array_equal(central.tied["distal"], intact().tied["distal"])
    assert len(intact().tied["distal"]) > 2
    assert len(terminal.tied["distal"]) == 0
    assert set(terminal.springs) == set(intact().springs)


def test_a_lateral_band_loses_one_row_over_the_middle_phalanx():
    before, after = intact(), cut_part(intact(), "lateral_band_radial")
    gone = {tuple(q) for q in before.points[before.quads].mean(axis=1).round(9)} - {
        tuple(q) for q in after.points[after.quads].mean(axis=1).round(9)
    }
    station = before.station[before.quads[before.cells("lateral_band_radial")]]
    row = ((station.min(axis=1) <= 56) & (station.max(axis=1) > 56)).sum()
    assert 1 <= len(gone) == row <= 2
    assert before.cells("lateral_band_ulnar").sum() == after.cells("lateral_band_ulnar").sum()
    assert before.cells("lateral_band_radial").sum() == (
        after.cells("lateral_band_radial").sum() + row
    )


def test_springs_and_sets_stay_on_their_nodes():
    before, after = intact(), cut_part(intact(), "central_band")
    for name, held in after.springs.items():
        assert np.array_equal(after.points[held.nodes], before.points[before.springs[name].nodes])
        assert np.array_equal(held.anchors, before.springs[name].anchors)
    assert np.array_equal(after.points[after.tied["distal"]], before.points[before.tied["distal"]])


@pytest.mark.parametrize("part", OF_SHELL.cut)
def test_a_cut_changes_no_size_of_what_is_left(part):
    """Section over width, and extra length over length, are those of the part as it was laid."""
    case = load_case("lesion_mallet", [COARSE])
    lengthen = {name: "0.2 mm" for name in LENGTHENED if name != part}
    lesion = LesionConfig(cut=(part,), lengthen=lengthen)
    before, after = intact(), apply_lesion_to_mesh(intact(), lesion)
    same = {tuple(x): i for i, x in enumerate(before.points[before.quads].mean(axis=1).round(9))}
    kept = [same[tuple(x)] for x in after.points[after.quads].mean(axis=1).round(9)]
    sizes = [thickness_of(case.hood, mesh) for mesh in (before, after)]
    assert sizes[1] == pytest.approx(sizes[0][kept], rel=1e-12)
    growth = [growth_of(case.hood, mesh, lesion) for mesh in (before, after)]
    assert growth[1] == pytest.approx(growth[0][kept], rel=1e-12)
    assert np.abs(growth[1]).max() > 1e-3


@pytest.mark.parametrize("part", OF_CABLES.cut)
def test_a_cut_changes_no_length_of_the_strands_that_are_left(part):
    before, after = net(), apply_lesion_to_net(net(), LesionConfig(cut=(part,)))
    assert after.strand_lengths().items() <= before.strand_lengths().items()


@settings(max_examples=20, deadline=None)
@given(share=st.floats(0.01, 0.99), part=st.sampled_from(OF_SHELL.cut_partly))
def test_a_cut_in_part_leaves_its_share_of_the_width(share, part):
    """From the radial side, whatever the quads: none of them moves, those cut through are gone."""
    before, after = intact(), cut_part_of(intact(), part, share)
    whole(after)
    row = np.flatnonzero(severed_row(before, part))
    lost = len(before.quads) - len(after.quads)
    assert lost < len(row)
    gone = share * width_of(before, row)
    assert width_of(after, severed_row(after, part)) == pytest.approx(
        width_of(before, row) - gone, abs=2e-3 * width_of(before, row)
    )
    most = before.points[before.quads[row], 1].max()
    if lost:
        assert after.points[after.quads[severed_row(after, part)], 1].max() < most


@pytest.mark.parametrize(("share", "quads"), [(0.998, 4), (0.9995, 3)])
def test_a_sliver_beside_a_cut_is_cut_too(share, quads):
    """Of a row of one quad in four."""
    held = strip(tied={"proximal": np.array([0, 1]), "distal": np.array([8, 9])})
    assert len(cut_part_of(held, "central_band", share).quads) == quads


def test_a_cut_takes_of_what_an_earlier_one_left():
    held = strip(tied={"proximal": np.array([0, 1]), "distal": np.array([8, 9])})
    twice = cut_part_of(cut_part_of(held, "central_band", 0.5), "central_band", 0.2)
    assert twice.left.tolist() == pytest.approx([1.0, 0.4, 1.0, 1.0])


def severed_row(mesh: HoodMesh, part: str) -> np.ndarray:
    """Which quads the part's place runs through."""
    station = mesh.station[mesh.quads]
    through = (station.min(axis=1) <= PLACES[part]) & (station.max(axis=1) > PLACES[part])
    return mesh.cells(part) & through


def width_of(mesh: HoodMesh, row: np.ndarray) -> float:
    """m, across the fibres, of the quads of a row: what is left of them."""
    every = np.arange(len(mesh.quads))
    each = [mesh.areas()[i] / mesh.length(every == i) for i in every[row]]
    left = 1.0 if mesh.left is None else mesh.left[row]
    return float((np.array(each) * left).sum())


def strip(count=4, region="central_band", **sets) -> HoodMesh:
    """A strip of quads along x through the place where the central band is cut (25.5 mm)."""
    x = np.linspace(20.0, 32.0, count + 1)
    points = np.array([[a, b, 0.0] for a in x for b in (0.0, 5.0)]) * 1e-3
    quads = np.array([[2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1] for i in range(count)])
    region_of = np.full(count, REGIONS.index(region))
    fibre = np.tile([1.0, 0.0, 0.0], (count, 1))
    given = {"ends": {}, "springs": {}, "tied": {}} | sets
    return HoodMesh(
        points,
        quads,
        region_of,
        fibre,
        given["ends"],
        given["springs"],
        given["tied"],
        points[:, 0] * 1e3,
        {},
        42.6e-3,
        6e-4,
    )


def test_a_piece_that_nothing_holds_is_left_out_and_one_that_is_pulled_refused():
    last = np.array([8, 9])
    loose = strip(tied={"distal": last}, ends={"central": last[:0]})
    assert len(cut_part(loose, "central_band").quads) == 2  # of 4 one is cut, one hangs on nothing
    pulled = strip(tied={"distal": last}, ends={"central": np.array([0, 1])})
    with pytest.raises(InputError, match=r"central_band: leaves a piece \(node [01]\)"):
        cut_part(pulled, "central_band")
    held = strip(
        tied={"distal": last},
        ends={"central": np.array([0, 1])},
        springs={"ligament_radial": Attachment("proximal", np.array([2]), np.zeros((1, 3)))},
    )
    assert len(cut_part(held, "central_band").quads) == 3


def test_what_a_mesh_has_not_cannot_be_cut():
    with pytest.raises(InputError, match="central_slip"):
        cut_part(strip(), "central_slip")
    with pytest.raises(InputError, match="lateral_band_ulnar at station 56 mm"):
        cut_part(strip(), "lateral_band_ulnar")


def test_a_hood_off_both_bones_is_refused():
    both = load_case("lesion_mallet", [COARSE, 'lesion.cut=["central_slip", "terminal_slip"]'])
    with pytest.raises(InputError, match="no insertion holds the hood"):
        build(both)


# Cuts of a net


@pytest.mark.parametrize("part", OF_CABLES.cut)
def test_every_part_of_a_net_can_be_cut_and_no_cable_hangs_loose(part):
    after = cut_net(net(), part)
    assert len(after.cells) < len(net().cells) or len(after.springs) < len(net().springs)
    assert np.array_equal(np.unique(after.cells), np.arange(len(after.points)))
    held = np.concatenate(
        [*after.ends.values(), *after.tied.values(), *(s.nodes for s in after.springs.values())]
    )
    joined = np.bincount(after.cells.ravel())
    assert np.all(np.isin(np.flatnonzero(joined == 1), held))
    assert np.array_equal(np.unique(after.strand), np.arange(len(after.strands)))
    for name, spring in after.springs.items():
        assert np.isin(after.points[spring.nodes], net().points[net().springs[name].nodes]).all()


def test_a_net_off_the_distal_phalanx_has_no_terminal_slip():
    after = cut_net(net(), "terminal_slip")
    assert "terminal_slip" in net().strands
    assert "terminal_slip" not in after.strands
    assert {"lateral_band_radial", "central_slip"} <= set(after.strands)


def test_the_uncut_is_as_it_was():
    assert apply_lesion_to_mesh(intact(), None) is intact()
    assert apply_lesion_to_net(net(), None) is net()


# Adhesions and lengths


def test_an_adhesion_holds_a_part_with_its_stiffness_in_every_direction():
    case = load_case("lesion_adhesion", [COARSE])
    mesh, lesion = intact(), case.lesion
    from cosim.fingers.kinds import skeleton_of
    from meshes.skeleton import BODIES

    rest = Motion(BODIES, *skeleton_of(case.finger).pose(mesh.rest_posture))
    grown = adhesions(lesion, mesh, mesh.points, rest)
    assert [g.name for g in grown] == ["adhesion_central_band_proximal"]
    springs = springs_of(grown)
    nodes = np.unique(springs.node)
    assert np.array_equal(nodes, np.unique(mesh.quads[mesh.cells("central_band")]))
    for shift in 1e-3 * STRUT * np.eye(3):
        moved = spring_forces(springs, mesh.points + shift, rest.position, rest.rotation, True)
        total = moved.gradient.sum(axis=0)
        assert total == pytest.approx(lesion.adhesion * shift, abs=2e-3 * lesion.adhesion * 5e-6)


def test_a_part_over_a_joint_grows_onto_both_bones():
    from cosim.fingers.kinds import skeleton_of
    from meshes.skeleton import BODIES

    case = load_case("lesion_adhesion", [COARSE, 'lesion.adhere=["central_slip"]'])
    rest = Motion(BODIES, *skeleton_of(case.finger).pose(intact().rest_posture))
    grown = adhesions(case.lesion, intact(), intact().points, rest)
    assert {g.name for g in grown} == {f"adhesion_central_slip_{b}" for b in ("proximal", "middle")}
    assert springs_of(grown).stiffness.sum() == pytest.approx(3 * case.lesion.adhesion)


def test_shorter_by_a_lesion_is_shorter_by_its_extra_length():
    stated = ('hood.extra_length.terminal_slip="0.2 mm"', 'lesion.shorten.terminal_slip="1 mm"')
    by_lesion = build(load_case("lesion_terminal_shortened", [COARSE, *stated])).hood
    alike = load_case(
        "lesion_terminal_shortened", [COARSE, 'hood.extra_length.terminal_slip="-0.8 mm"']
    ).model_copy(update={"lesion": None})
    grown = [h.model.tables.offset for h in (by_lesion, build(alike).hood)]
    assert np.abs(grown[0]).max() > 0.01
    assert grown[0] == pytest.approx(grown[1], rel=1e-12)


@pytest.mark.parametrize("name", ["central_slip", "lateral_band_radial"])
def test_more_than_half_of_a_part_cannot_be_taken(name):
    taken = [COARSE, f'lesion.shorten={{{name}="5 mm"}}', 'hood.extra_length.central_slip="-3 mm"']
    case = load_case("lesion_mallet", [*taken, "lesion.cut=[]"])
    if name == "lateral_band_radial":
        build(case)
        return
    with pytest.raises(InputError, match=r"central_slip: 8\.00 mm shorter"):
        build(case)


def test_a_sagittal_band_goes_with_its_sheet_and_leaves_the_tendon():
    before, after = intact(), cut_part(intact(), "sagittal_band_radial")
    assert "sagittal_radial" not in after.springs
    assert not after.cells("sagittal_band_radial").any()
    tendons = ("extensor_tendon_proximal", "extensor_tendon_distal", "sagittal_band_ulnar")
    assert after.cells(*tendons).sum() == before.cells(*tendons).sum()


def test_a_thin_sheet_is_taken_out_whole():
    after = cut_part(intact(), "triangular_ligament")
    assert not after.cells("triangular_ligament").any()
    assert len(intact().quads) - len(after.quads) == intact().cells("triangular_ligament").sum()


def test_a_net_s_extensor_tendon_is_severed_where_a_sheet_s_is():
    after = cut_net(net(), "extensor_tendon_distal")

    def over_the_cut(laid: CableNet) -> bool:
        own = laid.strand == laid.strands.index("extensor_tendon")
        beyond = laid.station[laid.cells[own]] > JOIN / 2
        return bool((beyond.any(axis=1) & ~beyond.all(axis=1)).any())

    assert over_the_cut(net())
    assert not over_the_cut(after)
    assert "central_band" in after.strands
