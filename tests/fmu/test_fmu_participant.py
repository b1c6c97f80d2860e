"""An FMU in a model's place: the native answers, rollback, tangents, and units that lack things."""

from __future__ import annotations

import gc
from ctypes import byref
from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.coupling.accelerators import Aitken
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium, equilibrium
from cosim.coupling.schemes import Explicit, Implicit, Linear, Newton, begin, step
from cosim.errors import ConvergenceError, InputError
from cosim.fingers.planar import planar_chain
from cosim.fmu.finger import FmuFinger
from cosim.fmu.hood import FmuHood
from cosim.fmu.quantity import tangent_of
from cosim.fmu.unit import Unit
from cosim.fmu_export.write import write_fmu
from cosim.models.build import Models, build, tensions
from cosim.port import STATIC, Hood, Motion, Pair, PairState, Tensions
from rigid.chain.joint_torques import joint_law
from tests.helpers.fmus import IN_PROCESS, NEEDS_FMU, change_description
from tests.helpers.moving_hinge import MovingHinge

pytestmark = NEEDS_FMU
BOTH = pytest.mark.parametrize("fmi", [2, 3])
CASE = load_case("pulley_edc")


@pytest.fixture(scope="module")
def models() -> Models:
    return build(CASE)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> dict[tuple[str, int], Path]:
    folder = tmp_path_factory.mktemp("units")
    paths = {
        (part, fmi): folder / f"{part}{fmi}.fmu" for part in ("hood", "finger") for fmi in (2, 3)
    }
    for (part, fmi), path in paths.items():
        write_fmu(CASE, part, fmi, path)
    return paths


def hood_of(path: Path, models: Models, **more: object) -> FmuHood:
    own = models.hood
    return FmuHood(path, own.bodies, own.tendons, own.sources, **more)


def couple(models: Models, hood: Hood) -> Equilibrium:
    start, pulls = models.finger.start(models.posture), tensions(CASE, models)
    before = PairState(start, hood.start(models.finger.motion(start)))
    options = CouplingOptions(CASE.solve.tolerance)
    return equilibrium(Pair(models.finger, hood), before, Tensions(*pulls), options)


def without_rollback(path: Path, folder: Path) -> Path:
    old, new = 'canGetAndSetFMUstate="true"', 'canGetAndSetFMUstate="false"'
    return change_description(path, folder / "forward_only.fmu", old, new)


def without_tangent(path: Path, folder: Path, models: Models, extra: str = "") -> Path:
    """The names of the tangent's outputs changed, so that they are not found."""
    new = change_description(path, folder / "bare.fmu", 'name="load_motion', 'name="other_motion')
    if extra:
        new = change_description(
            new, folder / "able.fmu", "<CoSimulation ", f"<CoSimulation {extra} "
        )
    return new


@BOTH
def test_a_hood_in_an_fmu_gives_the_native_equilibrium(written, models, fmi):
    native, ours = (
        couple(models, models.hood),
        couple(models, hood_of(written["hood", fmi], models)),
    )
    assert np.array_equal(ours.balance.tip_force, native.balance.tip_force)
    assert ours.iterations == native.iterations
    assert np.array_equal(ours.load.wrench, native.load.wrench)
    assert np.array_equal(ours.load.pull, native.load.pull)


@BOTH
def test_hood_and_finger_in_fmus_meet_where_the_native_ones_do(written, models, fmi):
    native = couple(models, models.hood)
    f = models.finger
    finger = FmuFinger(written["finger", fmi], f.bodies, f.joints, f.tendons)
    hood = hood_of(written["hood", fmi], models)
    start = PairState(finger.start({}), hood.start(finger.rest()))
    pulls, options = Tensions(*tensions(CASE, models)), CouplingOptions()
    both = equilibrium(Pair(finger, hood), start, pulls, options).finger_state
    assert np.abs(both.tip_force - native.known_balance.tip_force).max() <= 1e-9
    assert np.abs(both.angles - f.angles(native.finger_state)).max() <= 1e-9


def test_a_finger_takes_a_load_of_the_right_shape_only(written, models):
    f = models.finger
    finger = FmuFinger(written["finger", 2], f.bodies, f.joints, f.tendons)
    with pytest.raises(InputError, match=r"load_motion: expected shape \(24, 24\)"):
        finger.step(finger.start({}), np.zeros((4, 6)), np.zeros((6, 6)), np.zeros(len(f.tendons)))


@BOTH
@pytest.mark.parametrize("by", ["outputs", "differences"])
def test_the_tangent_is_the_native_one(written, models, fmi, by):
    hood = hood_of(written["hood", fmi], models)
    assert hood.tangent_by == "outputs"
    hood.tangent_by = by
    check_tangent(hood, models, 1e-7 if by == "differences" else 0.0)


def check_tangent(hood: FmuHood, models: Models, tolerance: float) -> None:
    motion = models.finger.motion(models.finger.start({"PIP": 0.6, "MCP": 0.2}))
    pulls = np.array([2.0, 0.0, 1.0, 0.3])
    expected = models.hood.advance(models.hood.start(motion), motion, pulls, STATIC).state
    found = hood.advance(hood.start(motion), motion, pulls, STATIC).state
    hood.advance(found, motion, 3 * pulls, STATIC)  # what happens next changes nothing
    pairs = zip(
        vars(hood.jacobian(found)).values(),
        vars(models.hood.jacobian(expected)).values(),
        strict=True,
    )
    for ours, native in pairs:
        assert ours.shape == native.shape
        assert np.abs(ours - native).max() <= tolerance * max(np.abs(native).max(), 1e-3)


def test_a_unit_without_tangent_outputs_is_differenced(written, models, tmp_path):
    hood = hood_of(without_tangent(written["hood", 2], tmp_path, models), models)
    assert hood.tangent_by == "differences"
    check_tangent(hood, models, 1e-7)


@BOTH
def test_directional_derivatives_are_taken_where_there_are_any(
    written, models, tmp_path, monkeypatch, fmi
):
    """The unit's own, in place of which the test differences the unit along the seed."""
    spelling = {2: "providesDirectionalDerivative", 3: "providesDirectionalDerivatives"}[fmi]
    path = without_tangent(written["hood", fmi], tmp_path, models, f'{spelling}="true"')
    hood = hood_of(path, models)
    assert hood.tangent_by == "directional derivatives"

    def derivative(self, unknown, known, seed):
        base, ends = self.save(), []
        seeds = np.split(seed, np.cumsum([place.size for place in known])[:-1])
        values = [self.get(place) for place in known]
        for sign in (1e-6, -1e-6):
            self.restore(base)
            for place, value, change in zip(known, values, seeds, strict=True):
                self.set(place, value + sign * change.reshape(value.shape))
            self.step(1e-3)
            ends.append(np.concatenate([self.get(place).ravel() for place in unknown]))
        self.restore(base)
        return (ends[0] - ends[1]) / 2e-6

    monkeypatch.setattr(Unit, "derivative", derivative)
    check_tangent(hood, models, 1e-6)


@BOTH
def test_any_state_may_be_advanced_from_any_number_of_times(written, models, fmi):
    hood, pulls = hood_of(written["hood", fmi], models), tensions(CASE, models)[0]
    motion = models.finger.motion(models.finger.start(models.posture))
    start = hood.start(motion)
    responses = [hood.advance(start, motion, k * pulls, 0.01) for k in (1.0, 2.0, 3.0)]
    for k, response in enumerate(responses, 1):
        again = hood.advance(response.state, motion, k * pulls, 0.01)
        assert np.array_equal(again.load.wrench, response.load.wrench)
        assert np.array_equal(response.state.tension, k * pulls)
    assert hood.unit.time == pytest.approx(0.02)


def test_states_are_let_go_of(written, models):
    hood, pulls = hood_of(written["hood", 2], models, loading=IN_PROCESS), tensions(CASE, models)[0]
    motion = models.finger.motion(models.finger.start(models.posture))
    state = hood.start(motion)
    for _ in range(30):
        state = hood.advance(state, motion, pulls, STATIC).state
    instance = hood.unit._instance
    assert instance is not None
    assert len(instance._states) <= 5


def test_states_outlive_other_units(written, models):
    """Units and states end in any order without bringing the process down."""
    pulls = tensions(CASE, models)[0]
    motion = models.finger.motion(models.finger.start(models.posture))
    for fmi in (2, 3, 2, 3):
        hood = hood_of(written["hood", fmi], models)
        loop = [hood.advance(hood.start(motion), motion, pulls, STATIC).state]
        loop.append(loop)
        del hood
    gc.collect()
    hood = hood_of(written["hood", 2], models)
    state = hood.advance(hood.start(motion), motion, pulls, STATIC).state
    hood.unit.restore(state.before)


def test_a_state_of_another_unit_is_refused(written, models):
    one, other = (hood_of(written["hood", 2], models) for _ in range(2))
    motion = models.finger.motion(models.finger.start(models.posture))
    with pytest.raises(InputError, match="of another unit"):
        one.advance(other.start(motion), motion, np.zeros(4), STATIC)


def test_a_unit_that_cannot_go_back_says_which_schemes_need_it(written, models, tmp_path):
    hood = hood_of(without_rollback(written["hood", 2], tmp_path), models)
    motion = models.finger.motion(models.finger.start(models.posture))
    pulls = tensions(CASE, models)[0]
    start = hood.start(motion)
    first = hood.advance(start, motion, pulls, 0.01)
    second = hood.advance(first.state, motion, 2 * pulls, 0.01)
    assert hood.jacobian(second.state).load_motion.any()
    with pytest.raises(InputError, match="implicit and newton, step control and tangents"):
        hood.advance(start, motion, pulls, 0.01)


def test_a_unit_without_a_switch_needs_a_time_to_rest_in(written, models, tmp_path):
    path = change_description(
        written["hood", 2], tmp_path / "timed.fmu", 'name="static"', 'name="still"'
    )
    motion = models.finger.motion(models.finger.start(models.posture))
    timed = hood_of(path, models)
    timed.advance(timed.start(motion), motion, np.zeros(4), 0.01)
    with pytest.raises(InputError, match=r"hood\.rest_step"):
        timed.advance(timed.start(motion), motion, np.zeros(4), STATIC)
    rested = hood_of(path, models, rest_step=0.5)
    rested.advance(rested.start(motion), motion, np.zeros(4), STATIC)
    assert rested.unit.time == 0.5


def test_other_names_are_mapped(written, models, tmp_path):
    path = change_description(
        written["hood", 2], tmp_path / "named.fmu", 'name="tension.', 'name="T_'
    )
    with pytest.raises(InputError, match=r"no variable tension\.EDC"):
        hood_of(path, models)
    hood = hood_of(path, models, names={"tension": "T_{tendon}"})
    assert np.array_equal(
        couple(models, hood).balance.tip_force, couple(models, models.hood).balance.tip_force
    )


def test_what_a_hood_must_not_be_given(written, models):
    hood = hood_of(written["hood", 2], models)
    motion = models.finger.motion(models.finger.start(models.posture))
    start = hood.start(motion)
    with pytest.raises(InputError, match="call advance first"):
        hood.jacobian(start)
    with pytest.raises(InputError, match="expected 4 finite tensions"):
        hood.advance(start, motion, np.zeros(3), STATIC)
    with pytest.raises(InputError, match="positive time step"):
        hood.advance(start, motion, np.zeros(4), 0.0)
    other = type(motion)(motion.bodies[::-1], motion.position, motion.rotation)
    with pytest.raises(InputError, match="its bodies are"):
        hood.advance(start, other, np.zeros(4), STATIC)


def test_a_failed_step_leaves_the_states_valid(written, models, monkeypatch):
    hood, pulls = hood_of(written["hood", 2], models, loading=IN_PROCESS), tensions(CASE, models)[0]
    motion = models.finger.motion(models.finger.start(models.posture))
    state = hood.advance(hood.start(motion), motion, pulls, STATIC)

    def lost(self, state, motion, tension, dt):
        raise ConvergenceError("the hood did not converge")

    monkeypatch.setattr(type(models.hood), "advance", lost)
    with pytest.raises(ConvergenceError, match=r"could not step from .* the hood did not converge"):
        hood.advance(state.state, motion, 2 * pulls, STATIC)
    monkeypatch.undo()
    again = hood.advance(state.state, motion, pulls, STATIC)
    assert np.array_equal(again.load.wrench, state.load.wrench)


@BOTH
def test_a_unit_is_heard_beside_another_and_after_it(written, models, fmi):
    """FMPy has one listener to units of FMI 2 in a process."""
    from fmpy import fmi2
    from fmpy.logging import addLoggerProxy

    elsewhere = fmi2.fmi2CallbackFunctions()
    elsewhere.logger = fmi2.fmi2CallbackLoggerTYPE(lambda *facts: None)
    units = [hood_of(written["hood", fmi], models, loading=IN_PROCESS) for _ in range(2)]
    motion = models.finger.motion(models.finger.start(models.posture))
    mirrored = Motion(motion.bodies, motion.position, -motion.rotation)
    for _ in range(2):
        with pytest.raises(ConvergenceError, match="is no rotation matrix"):
            units[0].advance(units[0].start(motion), mirrored, np.zeros(4), STATIC)
        del units[1:]
        gc.collect()
        addLoggerProxy(byref(elsewhere))


def test_a_loose_hood_shares_the_unit(written, models, monkeypatch):
    hood = hood_of(written["hood", 2], models, loading=IN_PROCESS)
    asked = []
    monkeypatch.setattr(
        type(models.hood), "with_tolerance", lambda self, tolerance: asked.append(tolerance) or self
    )
    motion = models.finger.motion(models.finger.start(models.posture))
    loose = hood.with_tolerance(1e-3)
    loose.advance(hood.start(motion), motion, np.zeros(4), STATIC)
    hood.advance(hood.start(motion), motion, np.zeros(4), STATIC)
    assert asked == [1e-3]
    assert loose.unit is hood.unit


def test_the_tangents_quantities_are_the_ports(models):
    own, motion = models.hood, models.finger.motion(models.finger.start({}))
    state = own.advance(own.start(motion), motion, np.ones(4), STATIC).state
    shapes = {q.name: int(np.prod(q.shape)) for q in tangent_of(own.bodies, own.tendons)}
    assert shapes == {name: value.size for name, value in vars(own.jacobian(state)).items()}


@pytest.fixture(scope="module")
def planar(tmp_path_factory) -> tuple[Models, dict[int, Path], MovingHinge]:
    """The planar finger in motion, its weight left out, and its hood as FMUs."""
    case = load_case("planar_edc")
    folder, models = tmp_path_factory.mktemp("planar"), build(case)
    paths = {fmi: folder / f"hood{fmi}.fmu" for fmi in (2, 3)}
    for fmi, path in paths.items():
        write_fmu(case, "hood", fmi, path)
    joints = models.finger.joints
    springs, damping = dict.fromkeys(joints, 0.2), dict.fromkeys(joints, 1e-3)
    law = joint_law(joints, springs, dict.fromkeys(joints, 0.3), damping=damping)
    return models, paths, MovingHinge(planar_chain(case.finger), law)


def swung(finger: MovingHinge, hood: Hood, scheme: object) -> list[np.ndarray]:
    """Angles under a tension that rises to 2 N in 40 ms."""
    pulls = lambda t: (np.array([min(50 * t, 2.0)]), np.zeros(0))  # noqa: E731
    state = begin(scheme, finger, hood, finger.begin(dict.fromkeys(finger.joints, 0.3)), pulls)
    angles = []
    for _ in range(20):
        state = step(scheme, finger, hood, state, pulls, 2e-3)
        angles.append(state.finger.angles)
    return angles


SCHEMES = [Explicit(), Explicit(parallel=True), Implicit(Aitken()), Newton(), Linear()]


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: type(scheme).__name__)
@BOTH
def test_every_scheme_moves_a_finger_as_with_the_native_hood(planar, fmi, scheme):
    models, paths, finger = planar
    native = swung(finger, models.hood, scheme)
    assert np.abs(native[-1] - native[0]).max() > 0.02
    assert np.array_equal(swung(finger, hood_of(paths[fmi], models), scheme), native)


@pytest.mark.parametrize(
    ("scheme", "runs"),
    [(Explicit(), True), (Linear(), True), (Implicit(Aitken()), False), (Newton(), False)],
    ids=["explicit", "linear", "implicit", "newton"],
)
def test_schemes_that_repeat_no_step_run_without_rollback(planar, tmp_path, scheme, runs):
    models, paths, finger = planar
    hood = hood_of(without_rollback(paths[2], tmp_path), models)
    if runs:
        native = swung(finger, models.hood, scheme)
        assert np.array_equal(swung(finger, hood, scheme), native)
        return
    with pytest.raises(InputError, match=r'coupling\.scheme = "explicit"'):
        swung(finger, hood, scheme)


def test_static_and_timed_steps_reach_the_hood_inside(written, models, monkeypatch):
    hood = hood_of(written["hood", 2], models, loading=IN_PROCESS)
    motion = models.finger.motion(models.finger.start(models.posture))
    steps, native = [], type(models.hood).advance
    monkeypatch.setattr(
        type(models.hood),
        "advance",
        lambda self, state, motion, tension, dt: (
            steps.append(dt) or native(self, state, motion, tension, dt)
        ),
    )
    for dt in (0.25, STATIC):
        hood.advance(hood.start(motion), motion, np.zeros(4), dt)
    assert steps == [0.25, STATIC]


def test_a_fingers_state_may_be_stepped_again(written, models):
    f = models.finger
    finger = FmuFinger(written["finger", 3], f.bodies, f.joints, f.tendons)
    start, wrench, own = finger.start({}), np.zeros((4, 6)), np.zeros(len(f.tendons))
    wrench[3, 2] = 0.3
    held = np.zeros((24, 24))
    first = finger.step(start, wrench, held, own)
    finger.step(first, 5 * wrench, held, own + 1)
    again = finger.step(start, wrench, held, own)
    assert np.array_equal(again.angles, first.angles)
    assert np.array_equal(again.tip_force, first.tip_force)
    assert np.linalg.norm(first.tip_force) > 0.01


@pytest.mark.parametrize("part", ["bodies", "tendons"])
def test_forces_that_the_case_does_not_name_are_refused(models, written, part) -> None:
    own = models.hood
    names = {"bodies": own.bodies, "tendons": own.tendons, "sources": own.sources}
    names[part] = names[part][:-1]
    with pytest.raises(InputError, match="would be lost; name all of its"):
        FmuHood(written["hood", 2], **names, loading=IN_PROCESS)
