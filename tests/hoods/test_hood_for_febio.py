"""A hood on tissue, written for FEBio by what its format can say, read back and solved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.hoods.fe_view import slip_forces
from cosim.models.build import build, tensions
from cosim.models.febio import HEAD, written_hood
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.forces.layer import Layer
from fe_solver.hood.as_febio import on_faces, replacements, with_sheet
from fe_solver.hood.as_job import job_of_hood, mirrored
from fe_solver.job.job import Job
from fe_solver.job.model import JobOptions, move_to_mid_surface
from fe_solver.job.solve import ShellState, solve_job
from fe_solver.supports import Body
from fe_solver.surfaces.spline_distance import SplineDistance
from tests.helpers.febio_schema import faults
from tests.helpers.jobs import rod_hood, run, strip

SPACING = 1e-3
TENSION = np.array([4.0])


def tissue_hood():
    """The hood on a thinner rod under a layer of 1 mm that ends in one of 0.5 mm, with some bending
    of its own."""
    hood, _ = rod_hood()
    model, sheet = hood.model, hood.sheet
    rod = trimesh.creation.cylinder(7e-3, sections=128, segment=[[-0.01, 0, 0], [0.04, 0, 0]])
    bones = {"rod": (np.array(rod.vertices), np.array(rod.faces))}
    bare = SplineDistance.bake(*bones["rod"], 0.5e-3, 5e-3)

    def less(x):
        u = np.clip(x[:, 0] / 20e-3, 0, 1)
        return 0.5e-3 * u**3 * (10 - 15 * u + 6 * u * u)

    thinner, modulus = bare.fields(lambda x: (less(x), one_mpa(x)))
    surface = replace(bare, coefficients=bare.coefficients + thinner.coefficients)
    thickness = replace(bare, coefficients=1e-3 - thinner.coefficients)
    layer = Layer(thickness, modulus, (1e-3, 1e6))
    (contact,) = model.contacts
    contact = replace(contact, surface=surface, offset=contact.offset + 1e-3, layer=layer)
    part = replace(sheet.parts[0], bending=2e6 * np.eye(3))
    sheet = replace(sheet, parts=(part,))
    model = replace(model, section=sheet.section, contacts=(contact,))
    return replace(hood, model=model, sheet=sheet), bones


def one_mpa(x):
    return np.full(len(x), 1e6)


def test_penalties_on_a_surface_of_equal_energy_press_as_the_tissue_does(tmp_path):
    """The hood with what is written in its place pulls its tip as the hood itself does; the file of
    it, read back, as that."""
    hood, bones = tissue_hood()
    motion = hood.rest
    state = hood.advance(hood.start(motion), motion, TENSION, np.inf).state
    found = replacements(hood, lambda: state, (), SPACING / 2)
    written = found.apply(hood)
    answer = written.advance(written.start(motion), motion, TENSION, np.inf)
    own = hood.response(state).load.wrench
    largest = np.abs(own).max(axis=(0, 1))
    assert np.abs(answer.load.wrench.sum(1) - own.sum(1)).max(0)[:3] == pytest.approx(
        np.zeros(3), abs=0.05 * largest[:3].max()
    )
    job = job_of_hood(written, motion, TENSION, {**bones, **found.surfaces})
    write_feb(job, tmp_path / "hood.feb", remarks=["one -- two"])
    assert faults(tmp_path / "hood.feb") == []
    assert "one - - two" in (tmp_path / "hood.feb").read_text()
    again = read_feb(tmp_path / "hood.feb")
    assert [c.automatic for c in again.contacts] == [False] * len(job.contacts)
    options = JobOptions(spacing=SPACING / 2)
    (last,) = solve_job(move_to_mid_surface(again), options=options).states
    touched = answer.load.wrench[0, answer.load.sources.index("contact"), :3]
    assert last.contact[0] == pytest.approx(touched, abs=0.01 * np.abs(touched).max())


@pytest.mark.parametrize("turned", [False, True])
def test_parts_share_their_faces_towards_the_bones(turned):
    """Whichever way the normals point; the mid-surface of the thicker one lies farther off."""
    hood, _ = rod_hood(turned=turned)
    X, quads = hood.sheet.points, hood.sheet.quads
    thickness = np.where(X[quads, 0].mean(axis=1) < 15e-3, 0.5e-3, 0.3e-3)
    sheet = on_faces(with_sheet(hood, replace(hood.sheet, thickness=thickness))).sheet
    outwards = np.sign((hood.model.directors * X * [0, 1, 1]).sum(axis=1))
    assert (outwards == outwards[0]).all()
    face = outwards[0] * sheet.height - sheet.thickness[:, None] / 2
    for node in np.unique(quads):
        assert np.ptp(face[quads == node]) < 1e-12
    assert np.ptp(sheet.height) > 0.05e-3


def test_a_mirrored_body_turns_as_its_image():
    """R becomes M R M, of the mirror image M, and its place M p."""
    turned = Body("bone", origin=(1e-3, 2e-3, 3e-3), displacement=(1e-3,) * 3, rotation=(1, 2, 3))
    (place, rotation), image = turned.pose(1.0), np.diag([1.0, -1.0, 1.0])
    (body,) = mirrored(strip(bodies=(turned,))).bodies
    expected = image @ place, image @ rotation @ image
    for found, wanted in zip(body.pose(1.0), expected, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-15)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"left": np.full(112, 0.5)}, "cut partly"),
        ({"quads": np.zeros((112, 9), dtype=np.intp)}, "nine-node"),
        (None, "cables"),
    ],
)
def test_what_no_file_can_say_is_refused_before_anything_is_solved(change, words):
    hood, _ = tissue_hood()
    sheet = change and replace(hood.sheet, **change)
    with pytest.raises(InputError, match=words):
        replacements(replace(hood, sheet=sheet), lambda: pytest.fail("solved"), ())


@pytest.mark.slow
def test_export_and_solve_of_the_first_case_give_the_same_hood(tmp_path):
    """`cosim export` and `cosim solve` agree within 1 % with the hood as written, and the export
    tells how far that is from the hood itself."""
    name, setting, feb = "isometric_edc", "hood.mesh.quads=104", tmp_path / "x.feb"
    told = run("export", name, "--set", setting, "--out", feb)
    assert told.exit_code == 0, told.output
    assert HEAD in told.output
    assert "all of these together" in told.output
    assert "all of these together" in feb.read_text()
    case = load_case(name, [setting])
    models = build(case)
    written, (pull, _) = written_hood(case, models), tensions(case, models)
    hood = written.hood
    answer = hood.advance(hood.start(written.motion), written.motion, pull, np.inf)
    slips = slip_forces(hood, answer.state)
    job = read_feb(feb)
    (state,) = solve_job(job).states
    assert slips_of(job, state) == pytest.approx(slips, rel=0.01)
    solved = run("solve", feb, "--out", tmp_path / "run")
    assert solved.exit_code == 0, solved.output


def slips_of(job: Job, state: ShellState) -> dict[str, float]:
    """N, of the springs of the central slip together, and of what is tied."""
    sets = [i for i, s in enumerate(job.springs) if s.name.startswith("central_slip")]
    central = sum(state.wrench[f"spring {i}"][:, :3].sum(axis=0) for i in sets)
    tied = state.wrench["tie"][:, :3].sum(axis=0)
    return {"central": float(np.linalg.norm(central)), "terminal": float(np.linalg.norm(tied))}


STATIC = (
    *("isometric_edc_holzapfel", "isometric_edc_neo_hookean"),
    "isometric_edc_transversely_isotropic",
    *("fingertip_fibres_edc", "fingertip_isotropic_edc", "free_fdp", "hood_rest", "muscle_edc"),
    *("isometric_fdi", "isometric_lum", "lesion_mallet", "lesion_boutonniere"),
)


@pytest.mark.slow
@pytest.mark.parametrize("name", STATIC)
def test_static_shell_cases_are_written_or_refused_for_what_is_so(name, tmp_path):
    feb = tmp_path / "x.feb"
    told = run("export", name, "--set", "hood.mesh.quads=104", "--out", feb)
    if told.exit_code == 0:
        assert faults(feb) == []
        assert read_feb(feb).contacts
    else:
        assert told.exit_code == 2, told.output
        assert not feb.exists()
        assert name == "fingertip_isotropic_edc"  # of a linear law
        assert "hood.extra_length.central_slip" in told.output
