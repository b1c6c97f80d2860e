"""Directions, second families and stretches in situ that a case gives its regions."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.case.file import load_case, resolved_toml
from cosim.cli import app
from cosim.errors import InputError
from cosim.fingers.kinds import skeleton_of
from cosim.hoods.shell.build import shell_hood_of, thickness_of
from cosim.hoods.shell.fibre_table import DirectionConfig
from cosim.hoods.shell.fibres import angles_at, fibres_of
from cosim.hoods.shell.view import _line_angle
from cosim.models.build import bone_surfaces, hood_mesh, site_of
from cosim.port import Motion
from cosim.results.strokes import SPACING, carry, stroke_cells, strokes
from fe_solver.elements.fibres import angle_between, turn_in_sheet
from fe_solver.hood.as_job import job_of_hood
from fe_solver.hood.fibre_families import fibre_families
from meshes.hood_mesh import REGIONS, HoodMesh
from meshes.skeleton import BODIES

CASE = "fingertip_fibres_edc"
SMALL = ("hood.mesh.quads=120", "hood.mesh.elements=linear")
SECOND = '{ c3 = "0.01 MPa", c4 = 150.0, c5 = "50 MPa", lam_max = 1.02, direction = %s }'
GASSER = (
    '{ kind = "holzapfel_gasser_ogden", c = "1 MPa", k1 = "5 MPa", k2 = 3.0, dispersion = 0.0%s }'
)
LINEAR = (
    '{ kind = "transversely_isotropic", modulus_along = "100 MPa", modulus_across = "5 MPa", '
    'shear_modulus = "2 MPa", poisson = 0.4, poisson_across = 0.4%s }'
)


def region_setting(region: str, key: str, value: str) -> str:
    return f"hood.regions.{region}.{key}={value}"


def direction(region: str, value: str) -> str:
    return region_setting(region, "direction", value)


@functools.cache
def mesh() -> HoodMesh:
    return hood_mesh(load_case(CASE, SMALL))


def fibre_directions(*settings: str):
    """The directions of a case with settings, on the small mesh."""
    case = load_case(CASE, [*SMALL, *settings])
    return fibres_of(mesh(), mesh().points, case.hood.regions, skeleton_of(case.finger))


def fibre_turns(region: str, *settings: str) -> np.ndarray:
    """deg, (k, g) from the mesh's own direction to the fibres, towards radial."""
    cells = mesh().region == REGIONS.index(region)
    own, first = fibre_directions().first[cells], fibre_directions(*settings).first[cells]
    return np.degrees(angle_between(mesh().points, mesh().quads[cells], own, first))


def test_an_angle_opens_distally_away_from_the_midline():
    for region, side in (("lateral_band_radial", 1), ("lateral_band_ulnar", -1)):
        seen = fibre_turns(region, direction(region, '{ angle = "20 deg" }'))
        assert seen == pytest.approx(np.full(seen.shape, 20.0 * side), abs=1e-9)
    cells = mesh().region == REGIONS.index("central_band")
    seen = fibre_turns("central_band", direction("central_band", '{ angle = "20 deg" }'))
    radial = mesh().points[mesh().quads[cells]].mean(axis=1)[:, 1]
    assert np.sign(seen.mean(axis=1)[np.abs(radial) > 1e-3]) == pytest.approx(
        np.sign(radial[np.abs(radial) > 1e-3])
    )


def test_in_a_sagittal_band_the_angle_is_from_the_finger_too():
    name = "sagittal_band_radial"
    assert np.abs(fibre_turns(name, direction(name, '{ angle = "90 deg" }'))) == pytest.approx(0)
    seen = fibre_turns(name, direction(name, '{ angle = "70 deg" }'))
    assert seen == pytest.approx(np.full(seen.shape, -20.0), abs=1e-9)


def test_angles_along_a_region_are_a_spline():
    name, table = (
        "lateral_band_radial",
        '{ along = [0.0, 0.5, 1.0], angle = ["0 deg", "10 deg", "40 deg"] }',
    )
    seen = fibre_turns(name, direction(name, table))
    station = mesh().station[mesh().quads[mesh().region == REGIONS.index(name)]]
    place = (station.mean(axis=1) - station.min()) / np.ptp(station)
    assert seen.mean(axis=1) == pytest.approx(20 * place**2 * 2, abs=1.5)


def test_angles_across_a_region_too():
    name = "lateral_band_ulnar"
    rows = '[["0 deg", "30 deg"], ["0 deg", "30 deg"]]'
    table = f"{{ along = [0.0, 1.0], across = [0.0, 1.0], angle = {rows} }}"
    seen = -fibre_turns(name, direction(name, table))
    cells = mesh().region == REGIONS.index(name)
    count = cells.sum() // len(
        np.unique(np.round(mesh().station[mesh().quads[cells]].mean(axis=1), 3))
    )
    assert count >= 1
    assert seen.min() > 0
    assert seen.max() < 30
    assert np.ptp(seen, axis=1) == pytest.approx(
        np.full(len(seen), 30 / np.sqrt(3) / count), rel=0.2
    )


def test_a_spline_is_level_beyond_its_places():
    table = DirectionConfig(along=(0.2, 0.8), angle=("10 deg", "40 deg"))
    seen = np.degrees(angles_at(table, np.array([0.0, 0.2, 0.5, 1.0]), np.zeros(4)))
    assert seen == pytest.approx([10, 10, 25, 40])


def test_a_second_family_crosses_the_first_in_the_mirror_of_the_other_side():
    bands = ("lateral_band_radial", "lateral_band_ulnar")
    settings = [direction(b, '{ angle = "20 deg" }') for b in bands]
    settings += [region_setting(b, "second", SECOND % '{ angle = "-35 deg" }') for b in bands]
    fibres = fibre_directions(*settings)
    for band, side in zip(bands, (1, -1), strict=True):
        angle = fibres.angle[REGIONS.index(band)]
        assert np.degrees(angle) == pytest.approx(np.full(angle.shape, -55.0 * side))


def test_a_field_of_the_mesh_is_one_too():
    name, i = "central_band", REGIONS.index("central_band")
    case = load_case(CASE, [*SMALL, direction(name, '{ field = "slips" }')])
    with pytest.raises(InputError, match=r"central_band\.direction\.field.*'slips'.*has none"):
        fibres_of(mesh(), mesh().points, case.hood.regions, skeleton_of(case.finger))
    oblique = turn_in_sheet(mesh().points, mesh().quads, fibre_directions().first, 0.5).mean(axis=1)
    own = HoodMesh(**{**vars(mesh()), "fields": {"slips": oblique}})
    seen = fibres_of(own, mesh().points, case.hood.regions, skeleton_of(case.finger)).first
    cells = mesh().region == i
    turn = angle_between(
        mesh().points, mesh().quads[cells], fibre_directions().first[cells], seen[cells]
    )
    assert turn == pytest.approx(np.full(turn.shape, 0.5), abs=0.06)
    assert np.array_equal(seen[~cells], fibre_directions().first[~cells])


def hood_with(*settings: str):
    case = load_case(CASE, [*SMALL, *settings])
    rest = Motion(BODIES, *skeleton_of(case.finger).pose({}))
    return case, shell_hood_of(case.hood, site_of(case, rest), mesh())


def test_a_hood_shows_its_families_and_its_strain_along_the_finger():
    name = "extensor_tendon_distal"
    _, hood = hood_with(
        direction(name, '{ angle = "25 deg" }'),
        region_setting(name, "second", SECOND % '{ angle = "-25 deg" }'),
        region_setting(name, "in_situ_stretch", "1.02"),
    )
    c = hood.start(hood.rest).configuration
    families, cells = fibre_families(hood.model, c), mesh().region == REGIONS.index(name)
    assert families.shape == (2, len(mesh().quads), 3)
    crossing = cells | mesh().cells("lateral_slip_radial", "lateral_slip_ulnar")
    assert not families[1][~crossing].any()
    assert np.linalg.norm(families[0], axis=1) == pytest.approx(np.ones(len(cells)))
    crossed = np.abs(np.einsum("ek,ek->e", *families[:, cells]))
    assert crossed == pytest.approx(np.full(cells.sum(), np.cos(np.radians(50))), abs=1e-3)
    turn = np.degrees(_line_angle(hood, mesh()))
    turned = crossing | mesh().cells("oblique_fibres_radial", "oblique_fibres_ulnar")
    assert not turn[~turned].any()
    assert np.abs(turn[cells]) == pytest.approx(np.full(cells.sum(), 25.0), abs=1e-6)


def test_fibres_stretched_in_situ_are_balanced_before_anything_moves():
    names = ("central_band", "lateral_band_radial", "lateral_band_ulnar")
    _, hood = hood_with(*(region_setting(name, "in_situ_stretch", "1.01") for name in names))
    assert (hood.sheet.stretch != 1.0).any()
    posed = hood.advance(hood.start(hood.rest), hood.rest, np.full(4, 0.05), 0.0)
    strain, cells = hood.strain(posed.state)[:, :, 0].mean(axis=1), mesh().cells(*names)
    assert strain[cells].mean() > 0.003  # of 0.01: the rest of the sheet gives way
    assert posed.load.imbalance(hood.rest)[0] < 1e-9


@pytest.mark.parametrize("on_face", [True, False])
def test_a_job_of_the_hood_has_its_fibres_and_its_stretch(on_face: bool):
    """Whichever way its quads face."""
    bands = ("lateral_band_radial", "lateral_band_ulnar")
    case, hood = hood_with(
        "hood.bending_stiffness=0 N*mm",
        "hood.regions.terminal_slip.sliding_fibres=false",
        "hood.extra_length.central_slip=0 mm",
        'hood.contact.stiffness="200 N/mm**3"',
        region_setting("central_slip", "in_situ_stretch", "1.03"),
        *(direction(b, '{ angle = "20 deg" }') for b in bands),
        *(region_setting(b, "second", SECOND % '{ angle = "-35 deg" }') for b in bands),
    )
    job = job_of_hood(hood, hood.rest, np.zeros(4), bone_surfaces(case), on_face=on_face)
    stretch = {p.name: p.in_situ_stretch for p in job.sheet.parts}
    assert stretch.pop("central_slip") == pytest.approx(1.03)
    assert set(stretch.values()) == {1.0}
    laid = thickness_of(case.hood, mesh())
    assert job.sheet.thickness == pytest.approx(np.tile(laid[:, None], 4))
    c = hood.start(hood.rest).configuration
    first, second = fibre_families(hood.model, c)
    corners = job.sheet.points[job.sheet.quads]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for part in (p for p in job.sheet.parts if p.name in bands):
        cells = mesh().region == REGIONS.index(part.name)
        f, angle = job.sheet.fibre[cells], part.law.angle
        turned = np.cos(angle) * f + np.sin(angle) * np.cross(normal[cells], f)
        assert np.abs(np.einsum("ek,ek->e", f, first[cells])).min() > 0.999
        assert np.abs(np.einsum("ek,ek->e", turned, second[cells])).min() > 0.99


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        (direction("central_band", '{ angle = "95 deg" }'), "must be 90 deg or less"),
        (direction("central_band", "{ angle = 20 }"), "is a bare number"),
        (direction("central_band", "{}"), "write either angle or field"),
        (direction("central_band", '{ angle = "9 deg", field = "f" }'), "write either angle or"),
        (direction("central_band", '{ angle = ["9 deg"] }'), "one angle, or along with a place"),
        (
            direction("central_band", '{ angle = "9 deg", along = [0, 1] }'),
            "2 angles, one for each",
        ),
        (direction("central_band", '{ angle = "9 deg", along = [1, 0] }'), "numbers must increase"),
        (direction("central_band", '{ angle = [["9 deg"], []], along = [0, 1] }'), "equally long"),
        (direction("central_band", '{ field = "f", along = [0, 1] }'), "do not go with field"),
        (
            region_setting("central_band", "second", SECOND.replace(", direction = %s", "")),
            "second.direction: is missing",
        ),
        (region_setting("central_band", "in_situ_stretch", "1.5"), "less than or equal to 1.2"),
        ("hood.regions.central_band=" + GASSER % "", "write either angle"),
        (
            'hood.regions.central_band={ kind = "isotropic", modulus = "9 MPa", poisson = 0.4, '
            'direction = { angle = "9 deg" } }',
            "unknown key",
        ),
    ],
)
def test_a_wrong_key_is_told_in_one_line(setting: str, words: str):
    answer = CliRunner().invoke(app, ["run", CASE, "--set", setting])
    assert answer.exit_code == 2
    assert words in " ".join(answer.output.split())
    assert "1 fault" in answer.output


def test_every_law_takes_a_second_family():
    second = 'second = { %s, direction = { field = "f" } }'
    gasser = second % 'k1 = "2 MPa", k2 = 3.0, dispersion = 0.1'
    linear = second % 'modulus = "50 MPa"'
    case = load_case(
        CASE,
        [
            "hood.regions.central_band=" + GASSER % f", {gasser}",
            "hood.regions.central_slip=" + LINEAR % f", {linear}",
            region_setting(
                "terminal_slip", "second", SECOND % '{ angle = ["9 deg", "8 deg"], along = [0, 1] }'
            ),
        ],
    )
    assert case.hood.regions["central_slip"].second.modulus == 50e6


def test_a_case_says_its_fibres_again(tmp_path):
    text = resolved_toml(
        load_case(
            CASE,
            [
                direction("central_band", '{ along = [0, 1], angle = ["0 deg", "10 deg"] }'),
                region_setting("central_band", "second", SECOND % '{ field = "slips" }'),
                region_setting("central_band", "in_situ_stretch", "1.01"),
            ],
        )
    )
    path = tmp_path / "again.toml"
    path.write_text(text)
    assert resolved_toml(load_case(path)) == text


def test_a_later_word_replaces_another_way_to_say_it(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(
        f'extends = "{CASE}"\n[hood.regions.central_band.direction]\n'
        'along = [0.0, 1.0]\nangle = ["0 deg", "10 deg"]\n'
    )
    case = load_case(path, ['hood.regions.central_band.direction.field="slips"'])
    assert case.hood.regions["central_band"].direction == DirectionConfig(field="slips")
    case = load_case(path, ['hood.regions.central_band.direction.angle="5 deg"'])
    assert case.hood.regions["central_band"].direction.along is None


@pytest.mark.parametrize("key", ["direction", "in_situ_stretch"])
def test_an_extra_length_goes_with_plain_fibres_alone(key: str):
    value = {"direction": '{ angle = "9 deg" }', "in_situ_stretch": "1.01"}[key]
    with pytest.raises(InputError, match=rf"hood\.extra_length\.central_slip.*{key}"):
        hood_with(region_setting("central_slip", key, value))


def test_strokes_are_few_and_lie_over_the_sheet():
    quads, points = mesh().quads, mesh().points
    dense = np.repeat(quads, 3, axis=0)
    cells = stroke_cells(points, dense)
    centre = points[dense[cells]].mean(axis=1)
    apart = np.linalg.norm(centre[:, None] - centre[None], axis=2) + np.eye(len(cells))
    assert apart.min() > SPACING
    ends = strokes(points, dense[cells], np.repeat(mesh().fibre, 3, axis=0)[cells])
    assert len(ends) == len(cells)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    seen = carry(quads, points, 1.1 * points @ turn.T, mesh().fibre)
    flat = np.einsum("ek,ek->e", seen, mesh().fibre @ turn.T)
    assert np.abs(flat).min() > 0.98
