"""Conditions that stand in one of several steps, in force in that step alone, against beams."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import InputError
from fe_solver.febio.write import write_feb
from fe_solver.job.curves import Drive, LoadCurve
from fe_solver.job.job import Job, Step
from fe_solver.job.phases import phases
from fe_solver.job.results import reactions
from fe_solver.job.solve import JobState, solve_job
from fe_solver.q4ans.solve import solve_solid
from fe_solver.supports import Body, Given, Tied
from tests.fe_solver.febio.test_feb_loads import (
    CONST,
    GRAVITY,
    HEAVY,
    STILL,
    STRESS,
    end_moved,
    moved,
    nodal,
    two_steps,
)
from tests.fe_solver.job.test_passing import block, raised
from tests.helpers.feb_strips import LENGTH, THICK, WIDTH, E, end_nodes
from tests.helpers.jobs import PLAIN, strip

SOLVERS = pytest.mark.parametrize("solver", [solve_job, solve_solid])
SECOND = WIDTH * THICK**3 / 12
WEIGHT = {"loads": CONST.format(axis="z", value=GRAVITY), "density": HEAVY}
"""A load that grows up to t = 1 and stays, of which t = 0.5 sees half."""
TOTAL = STRESS * LENGTH * WIDTH * THICK
SAG = -TOTAL * LENGTH**3 / (8 * E * SECOND)
"""mm, of the free end under the whole weight."""


def held_by(job: Job, state: JobState) -> dict[str, np.ndarray]:
    """The force (3,) N of each condition that is in force."""
    found = reactions(job, state.reaction, state.time)
    return {r.condition: r.force.sum(axis=0) for r in found}


def named(condition: str, name: str) -> str:
    return condition.replace("<bc", f'<bc name="{name}"')


PROP = named(STILL, "prop")


@SOLVERS
def test_a_support_of_the_first_step_is_released_in_the_second(tmp_path: Path, solver) -> None:
    """A propped cantilever, 3/8 q L at the prop; then the free one, q L^4 / 8 E I."""
    job = two_steps(tmp_path, PROP, "", **WEIGHT)
    propped, free = solver(job).states
    assert held_by(job, propped)["prop"][2] == pytest.approx(3 / 8 * TOTAL / 2, rel=0.01)
    assert end_moved(job, propped)[2] == 0.0
    assert end_moved(job, free)[2] == pytest.approx(SAG, rel=0.01)
    assert "prop" not in held_by(job, free)
    assert held_by(job, free)["f"][2] == pytest.approx(TOTAL, rel=1e-6)
    assert free.imbalance[0] < 1e-8 * TOTAL


@SOLVERS
def test_a_support_of_the_second_step_brings_the_end_back(tmp_path: Path, solver) -> None:
    """FEBio's zero displacement puts its nodes back, whatever the step before made of them."""
    job = two_steps(tmp_path, "", PROP, **WEIGHT)
    free, propped = solver(job).states
    assert end_moved(job, free)[2] == pytest.approx(SAG / 2, rel=0.01)
    assert end_moved(job, propped)[2] == pytest.approx(0, abs=1e-12)
    assert held_by(job, propped)["prop"][2] == pytest.approx(3 / 8 * TOTAL, rel=0.01)
    assert set(held_by(job, free)) == {"f", "s"}


@SOLVERS
@pytest.mark.parametrize("first", [True, False])
def test_a_motion_of_one_step_sets_in_and_goes_over_an_increment(
    tmp_path: Path, solver, first: bool
) -> None:
    """A small deflection: at half of the first increment it is the mean of what the two steps have
    at this time."""
    steps = (moved("0.3"), "") if first else ("", moved("0.3"))
    job = two_steps(tmp_path, *steps, **WEIGHT)
    before, between, after = solver(job, times=[0.5, 0.625, 1.5]).states
    given, free = (before, after) if first else (after, before)
    assert end_moved(job, given)[2] == pytest.approx(0.3)
    assert end_moved(job, free)[2] == pytest.approx(SAG * (1.0 if first else 0.5), rel=0.01)
    half = (0.3 + SAG * (0.625 if first else 0.5)) / 2
    assert end_moved(job, between)[2] == pytest.approx(half, rel=0.01)
    assert between.imbalance[0] < 1e-6


CLAMP = '<Boundary><bc name="clamp" node_set="right" type="rigid"><rb>block</rb></bc></Boundary>'
FIX = "".join(f"<R{d}_dof>1</R{d}_dof>" for d in "xyzuvw")
FIXED_BLOCK = f'<rigid_bc type="rigid_fixed"><rb>block</rb>{FIX}</rigid_bc>'


@SOLVERS
def test_nodes_are_tied_where_a_step_finds_them(tmp_path: Path, solver) -> None:
    """The end bends under a load, is clamped to a body where it is, and the load goes: the clamp
    bears it, and no moment."""
    load, force = nodal("0,0,2e-4"), 6e-4
    job = two_steps(tmp_path, load, CLAMP, rigid=FIXED_BLOCK)
    bent, clamped = solver(job).states
    assert end_moved(job, bent)[2] == pytest.approx(force * LENGTH**3 / (3 * E * SECOND), rel=0.01)
    np.testing.assert_allclose(end_moved(job, clamped), end_moved(job, bent), atol=1e-10)
    assert held_by(job, clamped)["clamp"][2] == pytest.approx(force, rel=1e-6)
    place = 1e3 * clamped.configuration.x[end_nodes(job)].mean(axis=0)
    about = np.array([LENGTH, WIDTH / 2, 0.0])
    wrench = clamped.wrench["tie"][0]
    arm = np.cross(1e-3 * (place - about), wrench[:3])
    np.testing.assert_allclose(wrench[3:] - arm, 0, atol=1e-4 * force * LENGTH * 1e-3)


def test_directors_are_turned_back_or_refused(tmp_path: Path) -> None:
    """A clamp of directors alone, from the second step on, at the end of a bent strip."""
    still = "".join(f"<s{d}_dof>1</s{d}_dof>" for d in "xyz")
    zero = "".join(f"<{d}_dof>1</{d}_dof>" for d in "xyz")
    clamp = (
        f'<Boundary><bc node_set="right" type="zero displacement">{zero}</bc>'
        f'<bc node_set="right" type="zero shell displacement">{still}</bc></Boundary>'
    )
    job = two_steps(tmp_path, "", clamp, **WEIGHT)
    with pytest.raises(InputError, match="is held from a step on before which it has turned"):
        solve_job(job)
    _, clamped = solve_solid(job).states
    ends = end_nodes(job)
    np.testing.assert_allclose(clamped.configuration.d[ends], job.sheet.directors[ends], atol=1e-9)
    couple = clamped.reaction[ends, 4].sum()
    assert couple == pytest.approx(TOTAL * LENGTH * 1e-3 / 12, rel=0.02)  # q L^2 / 12


def test_a_back_face_is_held_in_the_steps_of_its_front(tmp_path: Path) -> None:
    """Fronts of two steps cover a back face that both have alike."""
    front = '<bc node_set="right" type="zero displacement"><z_dof>1</z_dof></bc>'
    back = '<bc node_set="right" type="zero shell displacement"><sz_dof>1</sz_dof></bc>'
    both = f"<Boundary>{front}{back}</Boundary>"
    job = two_steps(tmp_path, both, both)
    assert [d.steps for d in job.held_directors] == [None] * 4
    job = two_steps(tmp_path, both, "")
    assert job.held_directors[-1].steps == (0,)
    with pytest.raises(InputError, match=r"along z \(sz_dof\) where the front face is free"):
        two_steps(tmp_path, both, f"<Boundary>{back}</Boundary>")


@SOLVERS
def test_contact_of_one_step_lifts_in_it_alone(solver) -> None:
    """A block rises under a strip, and stands there: without contact the strip is flat again."""
    job = raised(block(), 1e-3)
    (pair,) = job.contacts
    steps = (Step("touch", 1.0, 4), Step("leave", 2.0, 4))
    job = replace(job, steps=steps, contacts=(replace(pair, steps=(0,)),))
    result = solver(job, options=PLAIN)
    touching, left = result.states
    assert touching.contact[0, 2] < 0 < touching.configuration.x[:, 2].max()
    assert not left.contact.any()
    np.testing.assert_allclose(left.configuration.x, job.sheet.points, atol=1e-9)
    (alone,) = solver(replace(job, steps=steps[:1]), options=PLAIN).states
    np.testing.assert_allclose(touching.configuration.x, alone.configuration.x, atol=1e-12)
    assert result.touches[0].touched


def test_friction_keeps_its_memory_or_is_refused() -> None:
    job = raised(block(), 1e-3, friction=0.2)
    end = np.flatnonzero(np.isclose(job.sheet.points[:, 0], job.sheet.points[:, 0].max()))
    steps = (Step("touch", 1.0, 2), Step("on", 2.0, 2))
    tied = replace(job.ties[0], nodes=end, steps=(1,))
    job = replace(job, steps=steps, ties=(*job.ties, tied))
    with pytest.raises(InputError, match="friction, which remembers the way of its nodes"):
        solve_job(job, options=PLAIN)


def test_friction_goes_on_over_a_change_of_conditions() -> None:
    """A block rubs along a strip and back, and the conditions of a body far away change as it
    turns: what has slid by then has slid."""
    job = raised(block(), 0.6e-3, friction=0.3)
    rubbing, *others = job.bodies
    back = Drive(0.4e-3, LoadCurve((0.0, 1.0, 2.0), (0.0, 1.0, 0.0)))
    rubbing = replace(rubbing, displacement=(back, *rubbing.displacement[1:]))
    steps = (Step("there", 1.0, 2), Step("back", 2.0, 1))
    far = Body("far", motions=((Given.STAYS,) * 6, (Drive(),) * 6))
    drags = []
    for other in (Body("far"), far):
        turns = replace(job, bodies=(rubbing, *others, other), steps=steps)
        there, after = solve_job(turns, options=PLAIN).states
        assert there.contact[0, 0] < 0 < after.contact[0, 0]  # on the block
        drags.append(after.contact[0])
    np.testing.assert_allclose(*drags, rtol=1e-5, atol=1e-9)


def test_a_body_stays_where_a_step_fixes_it() -> None:
    """FEBio fixes a body where it is; what is prescribed comes from there in an increment, and the
    turn nearest to it counts, beyond half a turn too."""
    z, turn = (Drive(), Drive(), Drive(1.0)), (Drive(), Drive(4.0), Drive())
    kept, prescribed = (Given.STAYS,) * 6, (*z, Drive(), Drive(5.0), Drive())
    body = Body("b", motions=((*z, *turn), kept, prescribed))
    steps = [Step(str(i), float(i), 2) for i in (1, 2, 3)]
    job = Job(strip(1, 1).sheet, bodies=(body,), steps=steps)
    first, second, third = phases(job)
    at, turned = first.job.bodies[0].pose(1.0)
    (still,) = second.bodies(at[None], turned[None])
    for kept, begun in zip(still.pose(1.7), (at, turned), strict=True):
        np.testing.assert_allclose(kept, begun, atol=1e-12)
    (on,) = third.bodies(at[None], turned[None])
    assert [on.rotation[1].at(t) for t in (2.0, 2.25, 2.5)] == pytest.approx([4.0, 4.5, 5.0])
    assert on.displacement[2].at(2.1) == pytest.approx(1.0)


def test_conditions_of_some_steps_are_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="conditions of some of several steps are not written"):
        write_feb(two_steps(tmp_path, PROP, ""), tmp_path / "out.feb")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"ties": [Tied([0], 0, steps=(2,))]}, "names the step 2, and there are 2, from 0 on"),
        ({"bodies": [Body("b", free=(True,))]}, "body 'b': expected six motions"),
        ({"bodies": [Body("b", motions=((Given.FREE,) * 6,))]}, "motions: expected of 2 steps"),
    ],
)
def test_steps_that_are_not_there_are_refused(more: dict, words: str) -> None:
    steps = (Step("a", 1.0, 1), Step("b", 2.0, 1))
    with pytest.raises(InputError, match=words):
        Job(strip(1, 1).sheet, steps=steps, **{"bodies": [Body("b")], **more})


def test_springs_of_a_step_are_refused(tmp_path: Path) -> None:
    springs = '<Discrete><discrete dmat="1" discrete_set="x"/></Discrete>'
    with pytest.raises(InputError, match="springs of some of several steps are not read"):
        two_steps(tmp_path, springs, "")
