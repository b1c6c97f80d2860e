"""The hood on the bones: what the shell does behind the port.

The port's own promises are in test_conformance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cosim.case.file import load_case
from cosim.errors import ConvergenceError, InputError
from cosim.models.build import build, hood_mesh
from cosim.port import STATIC, Motion, Response
from fe_solver.elements.mesh_geometry import node_areas
from fe_solver.forces.guides import Ropes
from fe_solver.forces.springs import ROPE
from fe_solver.hood import shell_hood as shell_hood_module
from fe_solver.hood.build import ContactLaw, HoodSupports, TendonEnd, shell_hood
from fe_solver.hood.shell_hood import TIE, HoodState, ShellHood, _largest_turn
from fe_solver.materials.linear import Isotropic
from fe_solver.sheet import plate
from fe_solver.solver.fields import contact_pressure, fields
from fe_solver.solver.newton import NewtonOptions
from fe_solver.supports import Tied
from meshes.hood_mesh import HoodMesh
from meshes.skeleton import BODIES
from tests.helpers import shells
from tests.helpers.conformance import index_motions
from tests.helpers.jobs import roped_hood

TENSION = np.array([3.0, 1.0, 0.8, 0.5])
HIGH_AND_STRAIGHT = (
    "finger.tip.kind=posture",
    *(f"hood.mesh.rest_posture.{joint}=0 deg" for joint in ("MCP", "PIP", "DIP")),
    "hood.contact.offset.metacarpal=3.7 mm",
    "hood.contact.offset.proximal=2.2 mm",
    "hood.contact.offset.middle=1.15 mm",
    "hood.contact.offset.distal=0.1 mm",
    "hood.extra_length.terminal_slip=-1.23 mm",
    *(f"hood.springs.ligament_{side}.slack=4 mm" for side in ("radial", "ulnar")),
    *(f"hood.springs.sagittal_{side}.slack=2 mm" for side in ("radial", "ulnar")),
)
"""The isotropic sheet as high over the joints as An's tendons, free of stress when straight."""


def mesh_of(quads: int) -> HoodMesh:
    return hood_mesh(load_case("base/one_sheet.toml", [f"hood.mesh.quads={quads}"]))


@pytest.fixture(scope="module")
def mesh() -> HoodMesh:
    return mesh_of(250)


@pytest.fixture(scope="module")
def hood() -> ShellHood:
    return shells.index_hood()


@pytest.fixture(scope="module")
def motion() -> Motion:
    return index_motions()[1]


@pytest.fixture(scope="module")
def solved(hood: ShellHood, motion: Motion) -> Response:
    return hood.advance(hood.start(motion), motion, TENSION, STATIC)


def test_tied_and_guided_nodes_are_on_their_places(hood, solved, motion):
    c, model = solved.state.configuration, hood.model
    for held in (model.ties, model.guides):
        local = np.einsum(
            "kji,kj->ki", motion.rotation[held.body], c.x[held.node] - motion.position[held.body]
        )
        if held is model.ties:
            assert local == pytest.approx(held.position, abs=1e-15)
            d = np.einsum("kij,kj->ki", motion.rotation[held.body], held.director)
            assert c.d[held.node] == pytest.approx(d, abs=1e-14)
        else:
            beside = np.cross(local - held.origin, held.direction)
            assert beside == pytest.approx(np.zeros_like(beside), abs=1e-15)
    assert np.linalg.norm(c.d, axis=1) == pytest.approx(np.ones(len(c.d)), abs=1e-14)


@pytest.mark.parametrize(("friction", "ways"), [(0.0, 2), (0.2, 1)])
def test_friction_which_keeps_what_has_pulled_allows_no_detour(monkeypatch, motion, friction, ways):
    """A hood that is pulled at 18 N and let back to 12 is not one that is pulled at 12."""
    pulls = []

    def stuck(self: ShellHood, state: HoodState, motion: Motion, tension: np.ndarray) -> HoodState:
        pulls.append(tension)
        raise ConvergenceError("stuck")

    hood = shells.index_hood(f"hood.contact.friction={friction}")
    monkeypatch.setattr(ShellHood, "_solve_in_steps", stuck)
    with pytest.raises(ConvergenceError, match="stuck"):
        hood.advance(hood.start(motion), motion, TENSION, STATIC)
    assert len(pulls) == ways


def test_where_the_drift_leads_astray_it_is_left_out(monkeypatch, hood, motion):
    """No posture on the way is halved for it."""
    solve_once, drifts, postures = ShellHood._solve_once, [], []

    def astray(self, state, motion, tension, drift=None):
        drifts.append(drift)
        if drift is not None:
            raise ConvergenceError("crushed")
        postures.append(motion)
        return solve_once(self, state, motion, tension)

    monkeypatch.setattr(ShellHood, "_solve_once", astray)
    hood = replace(hood, leap=0.2)
    start = hood.start(motion)
    found = hood.advance(start, motion, TENSION, STATIC)
    turn = _largest_turn(start.motion, motion)
    assert any(drift is not None for drift in drifts)
    assert len(postures) == np.ceil(turn / hood.leap)
    assert np.isfinite(found.excursion).all()


def test_tendons_pull_along_the_metacarpal(hood, solved, motion):
    load = solved.load
    proximal = -motion.rotation[0][:, 0]
    assert load.pull[:, :3] == pytest.approx(np.outer(TENSION, proximal), abs=1e-12)
    moved = (solved.state.configuration.x - hood.model.reference) @ proximal
    turned = hood.rest.rotation[0] @ motion.rotation[0].T
    assert turned == pytest.approx(np.eye(3))  # the metacarpal is the world's
    nodes, central = hood.model.guides.node, slice(0, 2)
    slid = hood.model.share @ moved[nodes]
    assert solved.excursion[central] == pytest.approx(slid[central], abs=1e-15)


def test_intrinsic_tendons_run_through_their_eyelets(hood, solved, motion):
    """A rope pulls its end straight to the eyelet, and its excursion is by how much it shortens."""
    ropes, c = hood.model.ropes, solved.state.configuration
    assert set(np.flatnonzero(ropes.share.any(axis=1))) == {2, 3}
    assert ropes.share[2:].sum(axis=1) == pytest.approx(1)
    at = motion.position[0] + ropes.eyelet @ motion.rotation[0].T
    length = np.linalg.norm(c.x[ropes.node] - at, axis=1)
    laid = np.linalg.norm(hood.model.reference[ropes.node] - at, axis=1)
    assert solved.excursion[2:] == pytest.approx(ropes.share[2:] @ (laid - length), abs=1e-15)
    line = (at - c.x[ropes.node]) / length[:, None]
    pulled = -(TENSION @ ropes.share)[:, None] * line
    own = solved.state.solution.evaluation.points
    assert own.gradient[own.group == ROPE] == pytest.approx(pulled, abs=1e-12)


@pytest.mark.parametrize("tension", [6.0, 20.0])
def test_a_tendon_drawn_up_to_its_eyelet_is_named(tension):
    """At the eyelet its line has no direction: no 1 mm is left, or the solve is stuck there."""
    hood, _ = roped_hood()
    ropes, middle = hood.model.ropes, slice(4, 5)
    near = hood.model.reference[ropes.node[middle]] - [1.2e-3, 0, 0]
    one = Ropes(
        ropes.node[middle],
        ropes.body[middle],
        near,
        ropes.pull[middle],
        np.array([1.2e-3]),
        np.ones((1, 1)),
        ropes.tendons,
    )
    hood = replace(hood, model=replace(hood.model, ropes=one))
    with pytest.raises(ConvergenceError, match=r"EDC: its end .* up to the eyelet.*Lower its"):
        hood.advance(hood.start(hood.rest), hood.rest, np.array([tension]), STATIC)


def test_the_ledger_is_complete(hood, solved):
    forces = solved.load.wrench[..., :3].sum(axis=0)
    groups = hood.group_forces(solved.state)
    assert set(groups) == {*hood.groups, TIE}
    for name, force in groups.items():
        assert forces[hood.sources.index(name)] == pytest.approx(force, abs=1e-12)
    model, c = hood.model, solved.state.configuration
    assert hood.gap(solved.state).min() > -model.contacts[0].smoothing
    area = np.full(len(c.x), np.inf)
    for k in model.contacts:
        area[k.nodes] = k.area
    pressed = contact_pressure(model, c)[np.isfinite(area)] @ area[np.isfinite(area)]
    contact = np.linalg.norm(forces[hood.sources.index("contact")])
    assert 0 < contact <= pressed


def test_strain_is_the_fields(hood, solved):
    weight = hood.model.tables.weight
    mean = np.einsum("ng,ngc->nc", weight, hood.strain(solved.state)) / weight.sum(1)[:, None]
    seen = fields(hood.model, solved.state.configuration)
    assert seen.strain == pytest.approx(mean[:, :3], abs=1e-14)
    assert 0.005 < seen.strain[:, 0].max() < 0.2


def test_a_moved_hand_needs_no_iteration(hood, solved, motion):
    """The prediction is exact for a shift of the whole hand: guides, ties and free nodes alike."""
    shifted = motion.transform(np.eye(3), np.array([1e-3, -2e-3, 3e-3]))
    response = hood.advance(solved.state, shifted, TENSION, STATIC)
    assert response.state.iterations == solved.state.iterations
    assert response.excursion == pytest.approx(solved.excursion, abs=1e-12)


def test_a_small_turn_is_foreseen(hood, solved, motion):
    """From a known state a small turn takes fewer iterations than from afresh."""
    twist = np.zeros((4, 6))
    twist[1:, 4] = 2e-3
    near = hood.advance(solved.state, motion.displace(twist), TENSION, STATIC)
    afresh = hood.advance(hood.start(motion), motion.displace(twist), TENSION, STATIC)
    assert near.state.iterations - solved.state.iterations <= 5 < afresh.state.iterations
    wrench = afresh.load.wrench
    assert near.load.wrench == pytest.approx(wrench, abs=1e-6 * np.abs(wrench).max())


def test_a_loose_hood_stops_earlier_near_the_same_state(hood, solved, motion):
    loose = hood.with_tolerance(1e-2)
    response = loose.advance(loose.start(motion), motion, TENSION, STATIC)
    assert 1e3 * solved.state.solution.residual < response.state.solution.residual
    assert response.load.total() == pytest.approx(solved.load.total(), abs=0.1)
    assert hood.with_tolerance(1e-14).options == hood.options


def test_postures_on_the_way_are_solved_loosely_for_the_same_end(monkeypatch, hood):
    far = index_motions()[0]
    loose = hood.advance(hood.start(far), far, TENSION, STATIC).state
    monkeypatch.setattr(shell_hood_module, "ON_THE_WAY", 1e-3)
    tight = hood.advance(hood.start(far), far, TENSION, STATIC).state
    assert loose.configuration.x == pytest.approx(tight.configuration.x, abs=1e-10)
    assert loose.iterations < 0.8 * tight.iterations


def test_a_longer_terminal_slip_leaves_the_central_slip_more(hood, solved, motion):
    def central(extra: str) -> float:
        other = shells.index_hood(f"hood.extra_length.terminal_slip={extra}")
        response = other.advance(other.start(motion), motion, TENSION, STATIC)
        return float(np.linalg.norm(other.group_forces(response.state)["central_slip"]))

    laid = float(np.linalg.norm(hood.group_forces(solved.state)["central_slip"]))
    assert central("-0.5 mm") < 0.5 * laid
    assert central("0.5 mm") > 1.1 * laid


@pytest.mark.parametrize("elements", ["linear", pytest.param("quadratic", marks=pytest.mark.slow)])
def test_a_bent_hood_is_the_one_that_bends_there_slowly(elements):
    """An isotropic sheet rests at 60/60/40 deg with its central slip slack or taut.  Bent from
    straight it is taut; one leap from straight ends elsewhere, with less of the force."""
    bent = (f"finger.posture.{joint}" for joint in ('MCP="60 deg"', 'PIP="60 deg"', 'DIP="40 deg"'))
    mesh = "hood.mesh.quads=416", f'hood.mesh.elements="{elements}"'
    models = build(load_case("base/one_sheet.toml", [*mesh, *HIGH_AND_STRAIGHT, *bent]))
    hood, motion = models.hood, models.finger.motion(models.finger.start(models.posture))
    assert isinstance(hood, ShellHood)
    rest = np.full(len(hood.tendons), models.resting)

    def slip(leap: float) -> float:
        way = replace(hood, leap=leap)
        state = way.advance(way.start(motion), motion, rest, STATIC).state
        return float(np.linalg.norm(way.group_forces(state)["central_slip"]))

    assert slip(hood.leap) == pytest.approx(slip(hood.leap / 1.5), rel=0.01)
    assert slip(np.inf) < 0.8 * slip(hood.leap)


def test_a_turn_of_the_whole_hand_is_no_leap(hood, solved, motion):
    """Joints stay as they are: one solve, however far the hand turns."""
    turned = motion.transform(Rotation.from_rotvec([0.4, -1.9, 0.8]).as_matrix(), np.zeros(3))
    again = hood.with_tolerance(1e-9).advance(solved.state, turned, TENSION, STATIC)
    assert again.state.iterations == solved.state.iterations


def test_extra_length_is_the_slips(hood, mesh):
    """The slip's stress-free area grows in proportion to its length."""
    extra = 0.5e-3
    longer = shells.index_hood("hood.extra_length.terminal_slip=0.5 mm")
    ratio = longer.model.tables.weight.sum(axis=1) / hood.model.tables.weight.sum(axis=1)
    slip = mesh.cells("terminal_slip")
    assert ratio[~slip] == pytest.approx(np.ones((~slip).sum()))
    length = extra / (ratio[slip] - 1)
    assert length == pytest.approx(np.full(slip.sum(), 10e-3), rel=0.1)  # 63 to 73 mm


def test_a_state_that_was_not_solved_has_no_derivatives(hood, motion):
    with pytest.raises(InputError, match="call advance first"):
        hood.jacobian(hood.start(motion))


def test_what_cannot_be_solved_is_an_error_that_names_a_node(hood, motion, monkeypatch):
    def give_up(*args):
        raise ConvergenceError("it did not come to rest")

    monkeypatch.setattr("fe_solver.hood.shell_hood.relax", give_up)
    hasty = replace(hood, options=NewtonOptions(max_iterations=1))
    with pytest.raises(ConvergenceError, match=r"node \d+ at"):
        hasty.advance(hasty.start(motion), motion, TENSION, STATIC)


def test_where_newton_finds_nothing_a_damped_motion_comes_to_rest(
    hood, solved, motion, monkeypatch
):
    known = hood.advance(solved.state, motion, 1.1 * TENSION, STATIC)

    def stuck(*_: object) -> HoodState:
        raise ConvergenceError("stuck")

    monkeypatch.setattr(ShellHood, "_solve_once", stuck)
    monkeypatch.setattr("fe_solver.hood.shell_hood.MOST_HALVINGS", 0)
    found = hood.advance(solved.state, motion, 1.1 * TENSION, STATIC)
    assert found.load.wrench == pytest.approx(known.load.wrench, abs=1e-9)
    assert (known.state.attempt, found.state.attempt) == ("at once", "by a damped motion")


def test_half_of_a_step_is_tried_only_where_it_has_a_length(hood, solved, motion):
    """A pose that differs by rounding, as a coupling's next round asks for it, has none."""
    turned = replace(motion, position=motion.position + 1e-15)
    ways = [
        [attempt.name for attempt in hood._attempts(*to, 1, None)]
        for to in (
            (solved.state, turned, TENSION),
            (solved.state, turned, 1.1 * TENSION),
            (hood.start(motion), turned, TENSION),
        )
    ]
    assert ways == [["at once", "by a damped motion"], *2 * [["at once", "in halves"]]]


def test_a_hood_that_nothing_holds_is_refused(motion):
    sheet = plate(10e-3, 4e-3, 2, 1, Isotropic(1e8, 0.3), 5e-4)
    supports = HoodSupports(
        motion,
        np.tile([1.0, 0, 0, 0], (6, 1)),
        (),
        (),
        BODIES[0],
        np.array([-1.0, 0, 0]),
        {"EDC": TendonEnd(np.array([0, 1]), np.array([0.5, 0.5]))},
        ContactLaw(1e11, 5e-5, {}, {}),
        NewtonOptions(),
    )
    distal = motion.bodies.index("distal")
    for ties in ((), (Tied(np.zeros(0, dtype=np.intp), distal),)):
        with pytest.raises(InputError, match=r"no insertion holds the hood.*hood\.springs"):
            shell_hood(sheet, replace(supports, ties=ties))
    hood = shell_hood(sheet, replace(supports, ties=(Tied(np.array([4, 5]), distal),)))
    assert hood.sources == (TIE, "contact", "guide")


@pytest.mark.parametrize("setting", ['penetration="1 um"', "friction=0.2"])
def test_augmented_contact_does_not_penetrate_and_balances(motion, setting):
    """Over the bones' splines, whose gradients are not quite unit vectors."""
    hood = shells.index_hood(f"hood.contact.{setting}")
    first = hood.advance(hood.start(motion), motion, TENSION, STATIC)
    second = hood.advance(first.state, motion, 1.1 * TENSION, STATIC)
    for response in (first, second):
        assert -1e-6 <= hood.gap(response.state).min() < 1e-6
        total = response.load.wrench.sum(axis=(0, 1))[:3] - response.load.pull[:, :3].sum(axis=0)
        assert np.abs(total).max() < 1e-8
    again = hood.advance(first.state, motion, 1.1 * TENSION, STATIC)
    assert np.array_equal(again.load.wrench, second.load.wrench)
    rubbing = first.state.solution.model.contacts[1].grip
    assert (rubbing is not None and rubbing.limit.max() > 0) == setting.startswith("friction")


def test_nine_node_elements_touch_within_but_close_gaps_at_their_nodes():
    nine = 'hood.mesh.elements="quadratic"'
    smooth = shells.index_hood(nine).model
    held = np.concatenate([smooth.ties.node, smooth.guides.node])
    free = ~np.isin(smooth.quads, held).any(axis=1)
    assert 0.9 < free.mean() < 1
    for contact in smooth.contacts:
        assert len(contact.nodes) == 16 * free.sum()
        area = node_areas(smooth.reference, smooth.quads[free]).sum()
        assert contact.area.sum() == pytest.approx(area, rel=0.02)
    closed = shells.index_hood(nine, 'hood.contact.penetration="1 um"').model
    for contact in closed.contacts:
        assert set(contact.nodes) == set(range(len(closed.reference))) - set(held)


def turns(motion: Motion, sizes: list[float]) -> list[Motion]:
    """The finger's bodies turned about the flexion axis, rad."""
    twist = np.zeros((4, 6))
    twist[1:, 4] = 1.0
    return [motion.displace(size * twist) for size in sizes]


def walk(hood: ShellHood, solved: Response, motions: list[Motion]) -> HoodState:
    state = solved.state
    for motion in motions:
        state = hood.advance(state, motion, TENSION, STATIC).state
    return state


def test_a_prediction_misses_by_the_square_of_the_turn(hood, solved, motion):
    """And each spring that holds a node alone has the force that was predicted, however stiff it
    is."""
    m, state, misses = hood.model, solved.state, []
    count = np.bincount(m.springs.node, minlength=len(m.reference))
    held = np.concatenate([m.ties.node, m.guides.node])
    alone = (count[m.springs.node] == 1) & ~np.isin(m.springs.node, held)
    for ahead in turns(motion, [2e-5, 4e-5]):
        course, forces = hood._predict(state, ahead, TENSION)
        foreseen = course.guess(m)
        end = hood.advance(state, ahead, TENSION, STATIC).state.configuration
        misses.append(np.abs(end.x - foreseen.x).max())
        pull = m.evaluate(foreseen, TENSION, tangent=False).points.force[: len(alone)][alone]
        most = np.abs(pull).max()
        assert most > 0
        assert forces.points[: len(alone)][alone] == pytest.approx(pull, abs=1e-6 * most)
    assert misses[1] == pytest.approx(4 * misses[0], rel=0.5)


def miss(hood: ShellHood, state: HoodState, ahead: Motion) -> float:
    """How far (m) from the guess the hood comes to rest."""
    guess = hood._predict(state, ahead, TENSION)[0].guess(hood.model)
    return float(
        np.abs(hood.advance(state, ahead, TENSION, STATIC).state.configuration.x - guess.x).max()
    )


def test_a_steady_motion_is_foreseen_by_what_the_last_steps_missed(hood, solved, motion):
    """The first two steps tell by how much the tangent misses; the third is foreseen, whatever its
    length."""
    state = walk(hood, solved, turns(motion, [5e-5, 10e-5, 15e-5]))
    for ahead in (18e-5, 20e-5):
        [there] = turns(motion, [ahead])
        by_tangent = miss(hood, replace(state, course=None), there)
        assert miss(hood, state, there) < by_tangent / 2


@pytest.mark.parametrize(
    ("sizes", "ahead"),
    [([2e-5], 4e-5), ([2e-5, 4e-5, 6e-5], 4e-5), ([2e-5, 4e-5, 9e-5], 11e-5)],
    ids=["one step before", "back again", "not steady"],
)
def test_a_step_unlike_those_before_is_foreseen_by_the_tangent_alone(
    hood, solved, motion, sizes, ahead
):
    state, [there] = walk(hood, solved, turns(motion, sizes)), turns(motion, [ahead])
    if len(sizes) > 1 and ahead > sizes[-1]:
        state = replace(state, course=replace(state.course, steady=False))
    course, _ = hood._predict(state, there, TENSION)
    assert course.guess(hood.model) is course.end


def test_arrays_hold_all_that_the_next_step_begins_from(hood, solved, motion):
    first, second, third, fourth = turns(motion, [2e-5, 4e-5, 6e-5, 8e-5])
    state = walk(hood, solved, [first, second, third])
    assert state.course.steady
    again = hood.from_arrays(hood.to_arrays(state))
    one, other = (hood.advance(s, fourth, TENSION, STATIC) for s in (state, again))
    assert np.array_equal(one.load.wrench, other.load.wrench)
    assert np.array_equal(one.state.configuration.x, other.state.configuration.x)
    assert one.state.iterations == other.state.iterations
    jacobians = hood.jacobian(state), hood.jacobian(again)
    assert np.array_equal(*(j.load_motion for j in jacobians))
