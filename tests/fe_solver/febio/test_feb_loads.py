"""FEBio's body loads, pressure on either face, and conditions of one of several steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.job.curves import Drive
from fe_solver.job.job import Job, Step
from fe_solver.job.model import JobOptions, body_loads, dead_loads, job_model
from fe_solver.job.phases import phases
from fe_solver.job.solve import NO_TENSION, JobState, predict, solve_job
from fe_solver.q4ans.solve import solve_solid
from fe_solver.solver.newton import NewtonOptions, solve
from fe_solver.supports import Given
from tests.helpers.feb_files import read
from tests.helpers.feb_strips import (
    FIXED,
    LENGTH,
    THICK,
    WIDTH,
    E,
    end_nodes,
    read_strip,
    strip_text,
)

DENSITY, GRAVITY = 1e-9, 9810.0
"""t/mm3 and mm/s2: 1000 kg/m3 on Earth."""
HEAVY = f"<density>{DENSITY}</density>"
CONST = '<body_load type="const"><{axis} lc="1">{value}</{axis}></body_load>'
FORCE = '<body_load type="body force"><force lc="1">{}</force></body_load>'
STRESS = DENSITY * GRAVITY
"""N/mm3, the weight of a volume."""


def end_moved(job: Job, state: JobState) -> np.ndarray:
    """The mean displacement (3,) mm of the strip's end."""
    nodes = end_nodes(job)
    return 1e3 * (state.configuration.x - job.sheet.points)[nodes].mean(axis=0)


@pytest.mark.parametrize("solver", [solve_job, solve_solid])
def test_a_cantilever_bends_under_its_weight_against_the_body_load(
    tmp_path: Path, solver: object
) -> None:
    """q L^4 / 8 E I; the force is against FEBio's vector."""
    job = read_strip(tmp_path, "quad4", 16, CONST.format(axis="z", value=GRAVITY), density=HEAVY)
    (state,) = solver(job).states  # type: ignore[operator]
    second = THICK**2 / 12
    beam = -STRESS * LENGTH**4 / (8 * E * second)
    assert end_moved(job, state)[2] == pytest.approx(beam, rel=0.01)
    assert state.applied[:3] == pytest.approx([0, 0, -STRESS * LENGTH * WIDTH * THICK], abs=1e-12)
    assert state.imbalance[0] < 1e-8 * abs(state.applied[2])
    assert any("against the load's vector" in note for note in job.notes)


@pytest.mark.parametrize("solver", [solve_job, solve_solid])
@pytest.mark.parametrize("kind", ["quad4", "quad9", "tri6"])
def test_a_hanging_strip_stays_straight(tmp_path: Path, solver: object, kind: str) -> None:
    """Its weight acts on the mid-surface, though its nodes lie on a face: it grows by
    rho g L^2 / 2 E."""
    if kind == "quad9" and solver is solve_solid:
        return
    job = read_strip(tmp_path, kind, 4, FORCE.format(f"{-GRAVITY},0,0"), density=HEAVY)
    (state,) = solver(job).states  # type: ignore[operator]
    moved = end_moved(job, state)
    longer = STRESS * LENGTH**2 / (2 * E)
    assert moved[0] == pytest.approx(longer, rel=2e-3)
    assert abs(moved[2]) < 1e-3 * longer
    assert state.imbalance[1] < 1e-5 * abs(state.applied[0]) * THICK * 1e-3


def test_the_couples_of_a_weight_are_in_the_tangent(tmp_path: Path) -> None:
    """One step from half of a large weight predicts the whole of it to second order."""
    job = read_strip(tmp_path, "quad4", 4, FORCE.format(f"{4e4 * GRAVITY},0,0"), density=HEAVY)
    result = solve_job(job, times=[0.99, 1.0])
    model = job_model(job, JobOptions())
    states = [s.configuration for s in result.states]
    at = solve(model.at(0.99), states[0], NO_TENSION, NewtonOptions(tolerance=1e-10))
    guess = predict(model.at(1.0), at, states[0].position, states[0].rotation)
    step = np.abs(states[1].x - states[0].x).max()
    assert np.abs(guess.x - states[1].x).max() < 0.02 * step


def test_volumes_of_nodes_add_up(tmp_path: Path) -> None:
    for kind in ("quad4", "quad9", "tri3"):
        volumes = read_strip(tmp_path, kind, 2).sheet.volumes
        assert volumes.sum() == pytest.approx(LENGTH * WIDTH * THICK * 1e-9)
    one = read_strip(tmp_path, "tri3", 2).sheet.volumes[0]
    np.testing.assert_allclose([one[0], one[1], one[2] + one[3]], one.sum() / 3)


def test_body_loads_of_formulas_sets_and_densities(tmp_path: Path) -> None:
    load = '<body_load type="non-const" elem_set="few"><x>2*t</x><z>-3</z></body_load>'
    job = read_strip(tmp_path, loads=load, sets='<ElementSet name="few">2,5</ElementSet>')
    (force,) = job.body_forces
    assert force.quads.tolist() == [1, 4]
    assert [d.at(0.5) for d in force.acceleration] == pytest.approx([-1e-3, 0, 3e-3])
    np.testing.assert_allclose(force.density, 1e12)
    weight = body_loads(job, 0.5)
    assert weight is not None
    assert weight.sum(axis=(0, 1)) == pytest.approx(np.array([-1, 0, 3]) * 0.6, rel=1e-9)
    varied = read_strip(
        tmp_path,
        loads=load.replace(' elem_set="few"', ""),
        density='<density type="math">X</density>',
    )
    assert np.ptp(varied.body_forces[0].density) > 0
    with pytest.raises(InputError, match="not written"):
        write_feb(job, tmp_path / "out.feb")


@pytest.mark.parametrize(
    ("load", "words"),
    [
        ('<body_load type="centrifugal"/>', "body load 'centrifugal' is not read; known: const"),
        ('<body_load type="const"><x type="math">X</x></body_load>', "'X' is not known"),
        ('<body_load type="body force"/>', "<force> is missing"),
        ('<body_load type="const"><w>1</w></body_load>', "w.*may change the answer"),
        ('<surface_load type="traction" surface="@part_list:strip"/>', "'traction' is not read"),
    ],
)
def test_other_loads_are_refused_by_name(tmp_path: Path, load: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_strip(tmp_path, loads=load)


def test_a_mixtures_weight_is_refused(tmp_path: Path) -> None:
    load, negative = CONST.format(axis="z", value=1), "<density>-1</density>"
    with pytest.raises(InputError, match="has no weight that is read"):
        read_strip(tmp_path, loads=load, density=negative)
    solids = (
        '<k>100</k><solid type="Mooney-Rivlin"><density>1</density><c1>1</c1><c2>0</c2></solid>'
        '<solid type="uncoupled fiber-exp-linear"><c3>1</c3><c4>5</c4><c5>9</c5>'
        '<lambda>1.1</lambda><fiber type="vector">1,0,0</fiber></solid>'
    )
    text = strip_text(loads=load)
    first, last = text.index('type="isotropic elastic">'), text.index("</material>")
    path = tmp_path / "mixed.feb"
    path.write_text(f'{text[:first]}type="uncoupled solid mixture">{solids}{text[last:]}')
    with pytest.raises(InputError, match="has no weight that is read"):
        read_feb(path)


def test_a_nodal_load_is_a_force_along_an_axis(tmp_path: Path) -> None:
    load = (
        '<nodal_load type="nodal_load" node_set="right"><dof>{}</dof><scale lc="1">2</scale>'
        "</nodal_load>"
    )
    job = read_strip(tmp_path, loads=load.format("y"))
    assert dead_loads(job, 0.5)[end_nodes(job)].tolist() == [[0, 1, 0]] * 3
    for dof in ("p", "", "xy"):
        with pytest.raises(InputError, match="expected <dof> with x, y or z"):
            read_strip(tmp_path, loads=load.format(dof))


PRESSURE = (
    '<surface_load type="pressure" surface="@part_list:strip"><pressure lc="1">0.01</pressure>'
    "<shell_bottom>{}</shell_bottom></surface_load>"
)


def test_pressure_on_the_back_face_pushes_the_other_way(tmp_path: Path) -> None:
    front, back = (read_strip(tmp_path, loads=PRESSURE.format(i)) for i in (0, 1))
    assert front.pressures[0].sign.tolist() == [1] * 16
    assert back.pressures[0].sign.tolist() == [-1] * 16
    assert not any("back face" in n for n in back.notes)
    curved = read_strip(tmp_path, "quad4", 8, PRESSURE.format(1), bow=1.0)
    # a radius of L^2 / 8 h = 8 mm: the back face of 0.3 mm is 0.3/8 shorter at the crown
    (note,) = [n for n in curved.notes if "back face" in n]
    assert 3.0 < float(note.split("up to ")[1].split(" %")[0]) < 4.5


def test_a_back_face_held_alone_is_refused_with_the_cause(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"along z \(sz_dof\) where the front face is free.*set z_dof"
    ):
        read_strip(tmp_path, boundary=FIXED.replace("<z_dof>1", "<z_dof>0"))


def control(increments: int) -> str:
    return f"<Control><time_steps>{increments}</time_steps><step_size>0.25</step_size></Control>"


def step(name: str, increments: int, inner: str) -> str:
    return f'<step name="{name}">{control(increments)}{inner}</step>'


def nodal(value: str, lc: str = "") -> str:
    load = (
        f'<nodal_load node_set="right" type="nodal_force"><value{lc}>{value}</value></nodal_load>'
    )
    return f"<Loads>{load}</Loads>"


def two_steps(folder: Path, first: str, second: str, **more: str) -> Job:
    steps = f"<Step>{step('a', 2, first)}{step('b', 4, second)}</Step>"
    return read_strip(folder, control="", steps=steps, **more)


def test_a_load_lasts_as_long_as_its_step(tmp_path: Path) -> None:
    """At the ends of increments as in FEBio: t = 0.25, 0.5 of the first step, then to 1.5."""
    job = two_steps(tmp_path, nodal("0,0,1"), nodal("0,2,0", ' lc="1"'))
    assert job.steps == (Step("a", 0.5, 2), Step("b", 1.5, 4))
    end = end_nodes(job)[0]
    at = {t: dead_loads(job, t)[end].tolist() for t in (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0)}
    assert at[0.0] == at[0.25] == at[0.5] == [0, 0, 1]
    assert at[0.75] == [0, 1.5, 0]
    assert at[1.0] == at[1.5] == at[2.0] == [0, 2, 0]
    assert dead_loads(job, 0.625)[end].tolist() == [0, 0.5 * 2 * 0.625, 0.5]
    assert any("over its first increment" in n for n in job.notes)
    alone = two_steps(tmp_path, "", nodal("0,2,0"))
    assert dead_loads(alone, 0.5)[end].tolist() == [0, 0, 0]


def test_two_steps_are_solved_as_each_alone(tmp_path: Path) -> None:
    """The strip is elastic: the end of the second step forgets the first."""
    both = two_steps(tmp_path, nodal("0,0,1e-5"), nodal("0,2e-4,0"))
    for solver in (solve_job, solve_solid):
        first, last = solver(both).states
        for state, value in ((first, "0,0,1e-5"), (last, "0,2e-4,0")):
            load = nodal(value).removeprefix("<Loads>").removesuffix("</Loads>")
            (alone,) = solver(read_strip(tmp_path, loads=load)).states
            np.testing.assert_allclose(
                end_moved(both, state), end_moved(both, alone), rtol=1e-5, atol=1e-9
            )


def test_conditions_of_every_step_alike_are_the_files_own(tmp_path: Path) -> None:
    boundary = f"<Boundary>{FIXED}</Boundary>"
    renamed = boundary.replace('name="f"', 'name="other"')
    job = two_steps(tmp_path, boundary, renamed, boundary="")
    assert [h.component for h in job.held] == [0, 1, 2]
    assert all(h.displacement == Drive() for h in job.held)
    assert not any("Boundary" in n for n in job.notes)
    assert len(phases(job)) == 1


def moved(value: str, dof: str = "z", lc: str = "") -> str:
    return (
        f'<Boundary><bc node_set="right" type="prescribed displacement"><dof>{dof}</dof>'
        f"<value{lc}>{value}</value><relative>0</relative></bc></Boundary>"
    )


STILL = '<Boundary><bc node_set="right" type="zero displacement"><z_dof>1</z_dof></bc></Boundary>'


def test_motions_go_on_from_step_to_step(tmp_path: Path) -> None:
    """At the ends of increments as in FEBio; between them straight."""
    job = two_steps(tmp_path, moved("0.1", lc=' lc="1"'), moved("0.3"))
    (drive,) = {h.displacement for h in job.held if h.displacement != Drive()}
    at = {t: 1e3 * drive.at(t) for t in (0.0, 0.25, 0.5, 0.625, 0.75, 1.5)}
    assert at == pytest.approx(
        {0.0: 0, 0.25: 0.025, 0.5: 0.05, 0.625: 0.18125, 0.75: 0.3, 1.5: 0.3}
    )
    for solver in (solve_job, solve_solid):
        first, last = solver(job).states
        assert end_moved(job, first)[2] == pytest.approx(0.05)
        assert end_moved(job, last)[2] == pytest.approx(0.3)
    held = two_steps(tmp_path, STILL, moved("0.3")).held[-1]
    assert [1e3 * held.displacement.at(t) for t in (0.5, 0.75)] == pytest.approx([0, 0.3])
    assert len(held.nodes) == 3


def test_what_a_step_gives_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="gives otherwise too"):
        two_steps(tmp_path, moved("1") + moved("2"), moved("3"))


def test_bodies_move_on_from_step_to_step(tmp_path: Path) -> None:
    def turned(value: str) -> str:
        flags = "".join(f"<R{d}_dof>1</R{d}_dof>" for d in "xyzuw")
        return (
            f'<Rigid><rigid_bc type="rigid_fixed"><rb>bone</rb>{flags}</rigid_bc>'
            f'<rigid_bc type="rigid_rotation"><rb>bone</rb><dof>Rv</dof><value>{value}</value>'
            "</rigid_bc></Rigid>"
        )

    steps = f"<Step>{step('a', 1, turned('0.1'))}{step('b', 1, turned('0.4'))}</Step>"
    sections = {"Control": None, "Rigid": None, "Step": steps}
    body = read(tmp_path, sections).bodies[0]
    assert [body.rotation[1].at(t) for t in (0.25, 0.375, 0.5)] == pytest.approx([0.1, 0.25, 0.4])
    assert body.rotation[0] == Drive()
    alone = {**sections, "Step": steps.replace(turned("0.4"), "")}
    assert read(tmp_path, alone).bodies[0].motions[1] == (Given.FREE,) * 6


def test_a_relative_condition_of_a_step_is_refused(tmp_path: Path) -> None:
    relative = moved("1").replace("<relative>0", "<relative>1")
    with pytest.raises(InputError, match="<relative> other than 0"):
        two_steps(tmp_path, relative, relative)
