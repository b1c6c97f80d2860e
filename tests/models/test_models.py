"""From a case to models: what the case says ends up where it should."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import cosim
from cosim.analyses import ladder
from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.hoods.shell.view import strain_summary
from cosim.hoods.view import hood_field
from cosim.models.build import Models, build, hood_mesh, tensions
from cosim.port import STATIC
from fe_solver.materials.fibres import HolzapfelGasserOgden, TransIsoMooneyRivlin
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Orthotropic
from fe_solver.materials.tension_field import TensionField
from meshes.hood_mesh import REGIONS, HoodMesh, read
from tests.helpers.folders import ROOT

COARSE = "hood.mesh.quads=120"
DEFAULT_MESH = ROOT / "meshes" / "hoods" / "index_416.json"


@cache
def build_with(*settings: str) -> tuple[Models, HoodMesh]:
    case = load_case("base/one_sheet.toml", [COARSE, *settings])
    return build(case), hood_mesh(case)


def membrane(models: Models, modulus: float, poisson: float) -> np.ndarray:
    """(ne,) m, the thickness in the membrane stiffness E t / (1 - nu^2)."""
    return models.hood.model.section.linear[:, 0, 0, 0] * (1 - poisson**2) / modulus


def test_modulus_and_thickness_make_the_membrane_and_bending_stiffness():
    models, mesh = build_with("hood.regions.central_slip.thickness=0.4 mm")
    slip, sheet = mesh.cells("central_slip"), mesh.cells("central_band")
    assert slip.any()
    np.testing.assert_allclose(membrane(models, 100.76e6, 0.4)[slip], 0.4e-3)
    np.testing.assert_allclose(membrane(models, 100.61e6, 0.4)[sheet], 0.65e-3)
    stiffness = models.hood.model.section.linear[slip, 0]
    np.testing.assert_allclose(stiffness[:, 3, 3], stiffness[:, 0, 0] * 0.4e-3**2 / 12)


def test_a_bending_stiffness_adds_an_incompressible_sheet_in_bending_alone():
    (plain, _), (more, _) = build_with(), build_with("hood.bending_stiffness=0.3 N*mm")
    added = more.hood.model.section.linear - plain.hood.model.section.linear
    plate = 0.3e-3 / (1 - 0.5**2) * np.array([[1, 0.5, 0], [0.5, 1, 0], [0, 0, 0.25]])
    whole = np.zeros((8, 8))
    whole[3:6, 3:6] = plate
    np.testing.assert_allclose(added, np.broadcast_to(whole, added.shape), rtol=1e-9, atol=1e-12)


def test_a_section_is_thickness_times_mean_width():
    models, mesh = build_with("hood.regions.central_band.section=1.5 mm**2")
    cells = mesh.cells("central_band")
    thickness = membrane(models, 100.61e6, 0.4)[cells]
    assert np.ptp(thickness) < 1e-15
    nodes = np.unique(mesh.quads[cells])
    length = np.ptp(mesh.station[nodes]) * 1e-3
    volume = thickness[0] * mesh.areas()[cells].sum()
    assert volume / length == pytest.approx(1.5e-6, rel=0.05), "the region bends a little"


def test_a_thinner_region_keeps_its_face_on_the_bone():
    (plain, mesh), (thin, _) = (
        build_with(),
        build_with("hood.regions.central_band.thickness=0.25 mm"),
    )
    cells = mesh.cells("central_band")
    others = np.setdiff1d(np.arange(len(mesh.points)), mesh.quads[cells])
    inner = np.setdiff1d(mesh.quads[cells], mesh.quads[~cells])
    shift = thin.hood.model.reference - plain.hood.model.reference
    np.testing.assert_allclose(np.linalg.norm(shift[inner], axis=1), 0.2e-3, rtol=1e-9)
    np.testing.assert_array_equal(shift[others], 0.0)
    assert (np.einsum("ni,ni->n", shift[inner], plain.hood.model.directors[inner]) < 0).all()


def test_extra_length_is_free_of_stress_when_stretched_by_it():
    models, mesh = build_with("hood.extra_length.terminal_slip=0.5 mm")
    state = models.hood.start(models.hood.rest)
    strain = models.hood.strain(state)[..., 0]
    slip = mesh.cells("terminal_slip")
    growth = 0.5e-3 / mesh.length(slip)
    np.testing.assert_allclose(strain[slip], ((1 + growth) ** -2 - 1) / 2, rtol=1e-9)
    np.testing.assert_allclose(strain[~slip], 0.0, atol=1e-12)


def test_each_tendon_pulls_its_end_and_ei_the_ulnar_half():
    models, mesh = build_with()
    model = models.hood.model
    whole = np.hstack([model.share, model.ropes.share])
    np.testing.assert_allclose(whole.sum(axis=1), 1.0)
    every = np.concatenate([model.guides.node, model.ropes.node])
    nodes = {t: set(every[s > 0]) for t, s in zip(models.hood.tendons, whole, strict=True)}
    shares = dict(zip(models.hood.tendons, model.share, strict=True))
    assert nodes["EDC"] == set(mesh.ends["central"])
    assert nodes["LUM"] == set(mesh.ends["radial"])
    assert nodes["FPI"] == set(mesh.ends["ulnar"])
    assert nodes["EI"] < nodes["EDC"]
    radial = mesh.points[model.guides.node, 1]
    assert radial[shares["EI"] > 0].max() == pytest.approx(np.median(mesh.points[:, 1]), abs=3e-4)
    assert shares["EI"] @ radial < -1e-3
    assert shares["EDC"] @ radial == pytest.approx(0.0, abs=5e-4)


def test_tensions_go_to_the_tendons_by_name():
    case = load_case("isometric_edc", ["tendons.FDP.tension=2 N"])
    models, _ = build_with()
    hood, finger = tensions(case, models)
    np.testing.assert_allclose(hood, [3.469, 0.05, 0.05, 0.05])
    np.testing.assert_allclose(finger, [2.0, 0.05, 0.05, 0.05])


def test_a_tendon_that_neither_hood_nor_finger_has_is_told():
    case = load_case("isometric_edc", [*PULLEY, "tendons.LUM.tension=1 N"])
    with pytest.raises(InputError, match=r"tendons\.LUM: .*they have EDC, FDP, FDS, FDIm, FDIl"):
        tensions(case, build(case))


PULLEY = (
    "hood.kind=pulley",
    'hood.paths.EDC=[{body="metacarpal", point=["-1 cm", "0 mm", "8 mm"]},'
    ' {body="distal", point=["3 mm", "0.1 mm", "2 mm"]}]',
)
HINGE = (
    "finger.kind=hinge",
    *(f"finger.posture.{joint}=10 deg" for joint in ("MCP", "PIP", "DIP")),
    'finger.lengths=["46 mm", "28 mm", "20 mm"]',
    'finger.limit={half_range="0.3 rad", stiffness="7 Nm/rad", transition="1 deg"}',
)


def test_the_analytic_pair_is_built():
    case = load_case("isometric_edc", [*HINGE, *PULLEY])
    models = build(case)
    assert models.finger.joints == ("MCP", "PIP", "DIP")
    assert models.hood.tendons == ("EDC",)
    assert models.built.view is None
    state = models.finger.start(models.posture)
    tip = 46e-3 * np.exp(-0j) * np.exp(-1j * np.deg2rad(10))
    tip += 28e-3 * np.exp(-1j * np.deg2rad(20)) + 20e-3 * np.exp(-1j * np.deg2rad(30))
    np.testing.assert_allclose(models.finger.tip(state), [tip.real, 0.0, tip.imag], atol=1e-15)


@pytest.mark.parametrize("finger", [(), HINGE])
def test_a_straight_finger_cannot_be_held_at_its_tip(finger):
    straight = [f"finger.posture.{joint}=0 deg" for joint in ("PIP", "DIP")]
    with pytest.raises(InputError, match=r"finger\.posture: a straight finger .*finger\.tip"):
        build(load_case("isometric_edc", [*finger, *PULLEY, *straight]))
    free = build(load_case("isometric_edc", [*finger, *PULLEY, *straight, "finger.tip.kind=free"]))
    assert free.finger.angles(free.finger.start(free.posture))[-1] == 0.0


def test_a_shell_needs_bones():
    with pytest.raises(
        InputError, match=r'hood\.kind = "shell" does not go with finger\.kind = "hinge"'
    ):
        build(load_case("isometric_edc", list(HINGE)))


def test_a_hood_without_a_mesh_says_so():
    with pytest.raises(InputError, match="has no mesh of quads"):
        hood_mesh(load_case("isometric_edc", list(PULLEY)))


def test_a_finger_scales_in_length_and_width():
    (plain, mesh), (scaled, bigger) = build_with(), build_with("finger.length_scale=1.1")
    tips = [m.finger.tip(m.finger.start(m.posture)) for m in (plain, scaled)]
    np.testing.assert_allclose(tips[1], 1.1 * tips[0], rtol=1e-12)
    ends = [np.ptp(m.points[:, 0]) for m in (mesh, bigger)]
    assert ends[1] / ends[0] == pytest.approx(1.1, rel=0.01)
    _, wide = build_with("finger.width_scale=1.1")
    np.testing.assert_allclose(
        wide.springs["retinacular_radial"].anchors[:, 1:],
        1.1 * mesh.springs["retinacular_radial"].anchors[:, 1:],
        atol=2e-7,
    )
    over_pip = (mesh.station > 38) & (mesh.station < 47)
    widths = [np.ptp(m.points[over_pip, 1]) for m in (mesh, wide)]
    assert 1.05 < widths[1] / widths[0] < 1.12, "the offset over the bone does not scale"
    bones = [
        np.ptp(m.bones["middle"][0], axis=0)
        for m in (plain, build_with("finger.width_scale=1.1")[0])
    ]
    np.testing.assert_allclose(bones[1] / bones[0], [1.0, 1.1, 1.1], rtol=5e-3)


def test_the_committed_mesh_is_what_the_generator_makes(tmp_path: Path):
    from meshes.hood_mesh import write

    write(hood_mesh(load_case("base/one_sheet.toml")), tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == DEFAULT_MESH.read_bytes()


def test_a_mesh_file_reads_back_as_the_generated_mesh():
    generated, filed = hood_mesh(load_case("base/one_sheet.toml")), read(DEFAULT_MESH)
    np.testing.assert_allclose(filed.points, generated.points, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(filed.quads, generated.quads)
    np.testing.assert_array_equal(filed.region, generated.region)
    for name, attached in generated.springs.items():
        np.testing.assert_allclose(filed.springs[name].anchors, attached.anchors, atol=1e-12)
    assert filed.rest_posture == pytest.approx(generated.rest_posture)


def file_setting(path: Path) -> str:
    return f'hood.mesh={{kind="file", path="{path.as_posix()}"}}'


def edit_mesh(folder: Path, **changes: object) -> str:
    """The setting that takes the committed mesh with some keys changed."""
    content = json.loads(DEFAULT_MESH.read_text()) | changes
    path = folder / "mesh.json"
    path.write_text(json.dumps(content))
    return file_setting(path)


def test_a_mesh_of_fewer_regions_needs_no_others(tmp_path: Path):
    regions = json.loads(DEFAULT_MESH.read_text())["regions"]
    fewer = ["central_band" if "extensor" in name else name for name in regions]
    case = load_case("base/one_sheet.toml", [edit_mesh(tmp_path, regions=fewer)])
    sparse = {k: v for k, v in case.hood.regions.items() if "extensor" not in k}
    hood = case.hood.model_copy(update={"regions": sparse})
    models = build(case.model_copy(update={"hood": hood}))
    cells = np.array(fewer) == "central_band"
    np.testing.assert_allclose(membrane(models, 100.61e6, 0.4)[cells], 0.65e-3)


def test_a_region_of_the_mesh_without_a_material_is_told():
    case = load_case("base/one_sheet.toml", [file_setting(DEFAULT_MESH)])
    sparse = {k: v for k, v in case.hood.regions.items() if k != REGIONS[3]}
    hood = case.hood.model_copy(update={"regions": sparse})
    with pytest.raises(InputError, match=r"hood\.regions: the mesh also has central_slip"):
        build(case.model_copy(update={"hood": hood}))


def test_a_mesh_with_fewer_springs_is_held_by_those(tmp_path: Path):
    springs = json.loads(DEFAULT_MESH.read_text())["springs"]
    few = {k: v for k, v in springs.items() if k == "central_slip"}
    models = build(load_case("base/one_sheet.toml", [edit_mesh(tmp_path, springs=few)]))
    assert models.hood.groups == ("central_slip",)


def test_a_hood_that_nothing_holds_is_told(tmp_path: Path):
    case = load_case("isometric_edc", [edit_mesh(tmp_path, springs={}, tied={})])
    with pytest.raises(InputError, match="no insertion holds the hood"):
        build(case)


def test_a_mesh_file_of_another_finger_is_refused():
    case = load_case("isometric_edc", [file_setting(DEFAULT_MESH), "finger.length_scale=1.1"])
    with pytest.raises(InputError, match=r"laid on a finger of 42\.59 mm .* this one has 46\.84"):
        build(case)


def test_a_thinner_sheet_on_a_mesh_file_keeps_its_face_on_the_bone():
    case = load_case("base/one_sheet.toml", [file_setting(DEFAULT_MESH), "hood.thickness=0.45 mm"])
    shift = build(case).hood.model.reference - read(DEFAULT_MESH).points
    np.testing.assert_allclose(np.linalg.norm(shift, axis=1), 0.1e-3, rtol=1e-9)


def test_extra_length_of_a_region_that_the_mesh_lacks_is_refused(tmp_path):
    regions = json.loads(DEFAULT_MESH.read_text())["regions"]
    fewer = [name.replace("terminal_slip", "central_slip") for name in regions]
    longer = "hood.extra_length.terminal_slip=0.5 mm"
    case = load_case("base/one_sheet.toml", [edit_mesh(tmp_path, regions=fewer), longer])
    with pytest.raises(InputError, match=r"hood\.extra_length\.terminal_slip: the mesh has no"):
        build(case)


POSTURE = {"MCP": 0.5, "MCP_abduction": 0.0, "PIP": 0.8, "DIP": 0.25}
MATERIALS = {
    "transversely_isotropic": (
        'modulus_along="100 MPa", modulus_across="5 MPa", shear_modulus="4 MPa", poisson=0.4, '
        "poisson_across=0.4",
        Orthotropic,
    ),
    "neo_hookean": ('modulus="100 MPa", poisson=0.4', NeoHookean),
    "trans_iso_mooney_rivlin": (
        'c1="2 MPa", c2="0 MPa", c3="0.5 MPa", c4=60, c5="900 MPa", lam_max=1.03, '
        'bulk_modulus="2000 MPa"',
        TransIsoMooneyRivlin,
    ),
    "holzapfel_gasser_ogden": (
        'c="8 MPa", k1="60 MPa", k2=10, dispersion=0.1, angle="10 deg"',
        HolzapfelGasserOgden,
    ),
}


@pytest.mark.parametrize("kind", MATERIALS)
def test_a_region_of_any_material_solves(kind):
    text, law = MATERIALS[kind]
    models, mesh = build_with(f'hood.regions.central_band={{kind="{kind}", {text}}}')
    band = np.flatnonzero(mesh.cells("central_band"))
    patch = next(p for p in models.hood.model.section.patches if p.elements[0] in band)
    assert type(patch.law) is law
    assert np.array_equal(patch.elements, band)
    motion = models.finger.motion(models.finger.start(POSTURE))
    response = models.hood.advance(models.hood.start(motion), motion, np.full(4, 0.5), STATIC)
    wrench = response.load.wrench.sum(axis=1)
    total = wrench[:, :3].sum(axis=0) - response.load.pull[:, :3].sum(axis=0)
    assert np.abs(total).max() < 1e-8


@pytest.mark.parametrize("kind", MATERIALS)
def test_every_material_can_be_a_tension_field(kind):
    text, law = MATERIALS[kind]
    setting = f'hood.regions.central_band={{kind="{kind}", {text}, tension_field=true}}'
    models, mesh = build_with(setting)
    band = np.flatnonzero(mesh.cells("central_band"))
    patch = next(p for p in models.hood.model.section.patches if p.elements[0] in band)
    assert isinstance(patch.law, TensionField)
    assert type(patch.law.base) is law


def test_a_wrinkling_sheet_bears_less():
    """The same finger, straighter than the sheet was laid: it pushes less where it may wrinkle,
    and its states are told."""
    regions = load_case("base/one_sheet.toml").hood.regions
    wrinkling = [f"hood.regions.{name}.tension_field=true" for name in regions]
    pushes = []
    for settings in ((), wrinkling):
        models, _ = build_with(*settings)
        motion = models.finger.motion(models.finger.start(POSTURE | {"PIP": np.deg2rad(25)}))
        response = models.hood.advance(models.hood.start(motion), motion, np.full(4, 0.2), STATIC)
        strain = models.hood.strain(response.state)
        pushes.append(-models.hood.model.section.response(strain).force[..., :2].min())
        look = models.built.view(response.state)
        states = strain_summary(look).get("tension_field_area_percent")
    assert pushes[1] < 0.2 * pushes[0]
    assert set(look.tension) == {0, 1, 2}
    assert sum(states.values()) == pytest.approx(100)
    assert np.array_equal(hood_field(look).cell_data["tension_state"], look.tension)


def test_a_material_that_is_none_names_its_region():
    text = MATERIALS["transversely_isotropic"][0].replace("poisson=0.4,", "poisson=1.9,")
    text = text.replace('across="5', 'across="90')
    with pytest.raises(InputError, match=r"hood\.regions\.central_band: .*nu12"):
        build_with(f'hood.regions.central_band={{kind="transversely_isotropic", {text}}}')


@pytest.mark.parametrize("name", ["split_edc", "network_edc", "two_band_edc", "pulley_edc"])
def test_a_run_and_the_ladder_have_the_same_forces_in_the_slips(name, monkeypatch):
    """Whether the hood makes them or the finger's own tendons; none where there are no slips."""
    case = load_case(name, ["output.picture=false"])
    result = cosim.run(case)
    monkeypatch.setattr(ladder, "RUNGS", {case.hood.rung(): name})
    (rung,) = ladder.solve_rungs(case, 1)
    assert result.slips == pytest.approx(dict(rung.slips), rel=1e-9)
    assert bool(result.slips) == (name != "pulley_edc")


def test_a_finger_whose_own_tendons_make_the_slips_tells_their_forces():
    pull = cosim.load("split_edc")
    solved = cosim.couple(pull, pull, {"EDC": 3.0})
    assert solved.slips == pytest.approx({"central": 1.5, "terminal": 1.5}, rel=0.05)
    assert sum(solved.slips.values()) == pytest.approx(3.0, rel=1e-9)
