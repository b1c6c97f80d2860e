"""A hood reduced to one potential: against a network that it must recover, and behind the port."""

from __future__ import annotations

from dataclasses import replace

import conformance
import numpy as np
import pytest
from typer.testing import CliRunner

from cosim import reduction, reduction_walks
from cosim.build import Models, build
from cosim.build_finger import finger_model
from cosim.build_lumped import fitted, potential, reduced_hood, slip_forces
from cosim.case import find_case, load_case
from cosim.case_finger import IndexFinger
from cosim.case_lumped import NetworkHood
from cosim.cli import app
from cosim.port import STATIC, ConvergenceError, InputError, Motion
from cosim.reduced_case import case_text
from cosim.reduction_samples import Lost, Sample, Walk, on_models
from meshes.skeleton import BODIES, index_finger
from rigid.hinge_angle import angles, flexion_angles
from rigid.reduced_basis import loadings, monomials
from rigid.reduced_network import Potential
from rigid.reduction import Data, Order, reduced
from rigid.universal_angle import all_angles, chain_of, joints_of

TENDONS = ("edc_ulnar", "edc_slip", "edc_radial", "lum_slip", "lum_lateral", "fpi_slip")
SOFT = [f'hood.connecting.{t}.stiffness="{1 + 0.2 * i} N/mm"' for i, t in enumerate(TENDONS)]
SOFT.append('hood.connecting.fpi_lateral.stiffness="1.5 N/mm"')
"""So soft that every spring bears over the whole box, where the network is a polynomial."""
STRAIGHT = Order(angle=4, toe=None)


def soft_models() -> Models:
    return build(load_case("network_edc", [*SOFT, 'finger.tip.kind="free"']))


def walk(count: int, seed: int) -> Walk:
    rng = np.random.default_rng(seed)
    angle = rng.uniform([-0.1, 0.0, 0.1, 0.0], [0.6, 0.0, 0.9, 0.4], (count, 4))
    return Walk(angle, rng.uniform(7.0, 12.0, (6, 3)))


@pytest.fixture(scope="module")
def samples() -> list[Sample]:
    """Of the soft network, with the slips that its springs make."""
    case, models = load_case("network_edc", SOFT), soft_models()
    assert isinstance(case.hood, NetworkHood)
    assert isinstance(case.finger, IndexFinger)
    out = []
    for s in on_models(models, walk(28, 0)):
        assert isinstance(s, Sample)
        at = models.finger.start(dict(zip(models.finger.joints, s.angle, strict=True)))
        motion = models.finger.motion(at)
        state = models.hood.advance(models.hood.start(motion), motion, s.tension, STATIC).state
        slips = slip_forces(case.hood, case.finger, state)
        assert sum(slips.values()) == pytest.approx(s.tension.sum(), rel=1e-12)
        out.append(replace(s, slip=np.array([slips["central"], slips["terminal"]])))
    return out


@pytest.fixture(scope="module")
def found(samples) -> Potential:
    data = Data(**reduction.stacked(samples[:140]))
    return reduced(data, ("MCP", "MCP_abduction", "PIP", "DIP"), ("EDC", "LUM", "FPI"), STRAIGHT)


def test_a_network_is_recovered_to_round_off(samples, found):
    """Torques, excursions, all second derivatives and both slips in postures and under loads that
    were not fitted."""
    held = reduction.stacked(samples[140:])
    made = found.derived(held["angle"], held["tension"])
    for name, value in made._asdict().items():
        scale = np.abs(held[name]).max()
        assert np.abs(value - held[name]).max() < 1e-9 * scale, name
    slips = found.slips(held["angle"], made.torque)
    assert slips == pytest.approx(held["slip"], rel=1e-8)
    assert found.torques(held["angle"], held["tension"]) == pytest.approx(made.torque, rel=1e-12)


def test_second_derivatives_are_those_of_the_first():
    """Of every basis function against central differences."""
    rng, step = np.random.default_rng(1), 1e-5
    powers = rng.integers(0, 5, (30, 4))
    terms = rng.integers(0, 4, (30, 4))

    def toed(at):
        return loadings(terms, at, 0.05)

    for basis in (lambda at: monomials(powers, at), toed):
        at = rng.uniform(0.1, 0.9, 4)
        here = basis(at)
        for j, e in enumerate(step * np.eye(4)):
            up, down = basis(at + e), basis(at - e)
            slope = (up.value - down.value) / (2 * step)
            curve = (up.slope - down.slope) / (2 * step)
            assert here.slope[:, j] == pytest.approx(slope, rel=1e-6, abs=1e-8)
            assert here.curve[:, :, j] == pytest.approx(curve, rel=1e-6, abs=1e-8)


def any_potential() -> Potential:
    """Four joints and two muscles with all kinds of terms, abduction too."""
    rng = np.random.default_rng(2)
    powers = np.array(
        [(a, b, c, d) for a in (0, 1) for b in (0, 1, 2) for c in (0, 2) for d in (0, 1)]
    )
    terms = np.array([(0, 0), (1, 0), (0, 1), (2, 0), (0, 3), (1, 1)])
    low, high = np.array([-0.5, -0.3, -0.3, -0.3]), np.array([1.0, 0.3, 1.2, 0.6])
    energy = rng.normal(0, 2e-3, (len(powers), len(terms)))
    slip_powers, slip = powers[:1], np.zeros((2, 1, 5))
    slip[1, 0] = 0, 0, 0, 0, -300.0
    joints = ("MCP", "MCP_abduction", "PIP", "DIP")
    parts = (low, high, np.array([4.0, 3.0]), powers, terms, 0.05, energy, slip_powers, slip)
    return Potential(joints, ("EDC", "LUM"), *parts)


def test_one_state_is_as_in_a_batch():
    """Where the two ways to the derivatives could part: abduction, all springs, every order."""
    made, random = any_potential(), np.random.default_rng(3)
    angle, tension = random.uniform(made.low, made.high, (6, 4)), random.uniform(0, 3, (6, 2))
    batch = made.derived(angle, tension)
    for k in range(6):
        for one, many in zip(made.derived_at(angle[k], tension[k]), batch, strict=True):
            assert one == pytest.approx(many[k], rel=1e-12, abs=1e-16)


@pytest.mark.parametrize("seed", range(3))
def test_rates_of_all_angles_against_differences(seed):
    """Bodies turned and moved as no hinges allow, abduction's two hinges among them."""
    finger = load_case("network_edc").finger
    assert isinstance(finger, IndexFinger)
    model = finger_model(finger, None)
    chain, step = chain_of(joints_of(model), BODIES), 1e-6
    bent = Motion(BODIES, *index_finger().pose({"MCP": 0.5, "PIP": 1.4, "DIP": 0.6}))
    twist = np.random.default_rng(seed).uniform(-0.3, 0.3, 24)
    motion = bent.displaced(twist)
    found = all_angles(chain, motion)
    flexion = angles(flexion_angles(model)[1:], motion)
    assert found.value[2:] == pytest.approx(flexion.value, abs=1e-13)
    assert found.rate[2:] == pytest.approx(flexion.rate, abs=1e-13)
    for k in range(24):
        ahead, behind = (
            all_angles(chain, motion.displaced(sign * step * np.eye(24)[k])) for sign in (1, -1)
        )
        rate = (ahead.value - behind.value) / 2 / step
        assert found.rate[:, k] == pytest.approx(rate, abs=1e-8)
        slope = (ahead.rate - behind.rate) / 2 / step
        assert found.moment_rate[:, :, k] == pytest.approx(slope, abs=1e-8)


POSTURES = (
    {},
    {"MCP": 0.25, "MCP_abduction": 0.05, "PIP": 0.4, "DIP": 0.1},
    {"MCP": 0.5, "MCP_abduction": -0.1, "PIP": 0.8, "DIP": 0.3},
)


def test_the_hood_keeps_the_ports_promises():
    finger = load_case("network_edc").finger
    assert isinstance(finger, IndexFinger)
    hood = reduced_hood(any_potential(), finger, BODIES)
    motions = [Motion(BODIES, *index_finger().pose(posture)) for posture in POSTURES]
    tension = np.array([2.0, 1.5])
    conformance.check_shapes(hood, motions, tension)
    conformance.check_errors(hood, motions[0], tension)
    conformance.check_repeatable(hood, motions, tension)
    conformance.check_objective(hood, motions, tension, 1e-9)
    conformance.check_balance(hood, motions, tension)
    conformance.check_reciprocity(hood, motions, tension, 1e-6)
    conformance.check_jacobian(hood, motions, tension, 1e-6)


def test_every_joint_is_felt_with_its_own_torque():
    """Behind the port the joint torques, abduction's too, are the potential's derivatives."""
    case = load_case("network_edc")
    assert isinstance(case.finger, IndexFinger)
    made, models = any_potential(), build(case)
    hood = reduced_hood(made, case.finger, BODIES)
    angle, tension = np.array([0.4, 0.12, 0.7, 0.3]), np.array([2.0, 1.5])
    at = models.finger.start(dict(zip(models.finger.joints, angle, strict=True)))
    answer = hood.advance(
        hood.start(models.finger.motion(at)), models.finger.motion(at), tension, 1.0
    )
    torque = models.finger.jacobian(at).T @ answer.load.total().ravel()
    assert torque == pytest.approx(made.derived(angle, tension).torque, rel=1e-9)
    assert answer.excursion == pytest.approx(made.derived(angle, tension).excursion, rel=1e-9)
    assert hood.slip_forces(answer.state)["terminal"] == pytest.approx(max(0.0, -300 * torque[3]))


def test_outside_of_the_box_there_is_no_answer():
    made = any_potential()
    assert made.outside(made.high, made.most) == ""
    assert "PIP at 90 deg" in made.outside(np.array([0, 0, np.pi / 2, 0]), made.most)
    assert "LUM at 5 N" in made.outside(made.high, np.array([1.0, 5.0]))
    finger = load_case("network_edc").finger
    assert isinstance(finger, IndexFinger)
    hood = reduced_hood(made, finger, BODIES)
    bent = Motion(BODIES, *index_finger().pose({"PIP": 1.5}))
    with pytest.raises(ConvergenceError, match=r"PIP at 85\.94 deg"):
        hood.advance(hood.start(bent), bent, np.ones(2), STATIC)
    with pytest.raises(InputError, match="range of its angles or tensions is empty"):
        replace(made, high=made.low)
    with pytest.raises(InputError, match=r"energy \(A, G\)"):
        replace(made, energy=made.energy[1:])


def test_too_few_samples_are_refused(samples):
    with pytest.raises(InputError, match="too few"):
        fitted(
            reduction.stacked(samples[:3]),
            ("MCP", "MCP_abduction", "PIP", "DIP"),
            ("EDC", "LUM", "FPI"),
        )


def a_reduction(samples, found: Potential) -> reduction.Reduction:
    return reduction.Reduction(
        load_case("network_edc", SOFT),
        {"MCP": (0.0, 30.0)},
        {"EDC": 12.0},
        found,
        tuple(samples[:140]),
        tuple(samples[140:]),
        ("0/0 deg: why",),
        1.0,
        reduction.Rate(1e-3, 1e-5),
    )


def test_the_case_file_holds_the_potential(tmp_path, samples, found):
    text = case_text(
        a_reduction(samples, found), "it", "network_lum", ("tendons.EDC.tension=8 N", "hood.x=1")
    )
    text = text.replace('extends = "network_lum"', 'extends = "fingertip_isotropic_lum"')
    path = tmp_path / "made.toml"
    path.write_text(text)
    case = load_case(path)
    assert isinstance(case.hood, NetworkHood)
    assert case.hood.reduced is not None
    assert case.tension("EDC") == 8.0
    again = potential(case.hood.reduced)
    assert again.energy == pytest.approx(found.energy, rel=1e-8)
    assert again.slip == pytest.approx(found.slip, rel=1e-8)
    assert np.array_equal(again.angle_powers, found.angle_powers)
    assert again.low == pytest.approx(found.low, abs=1e-12)
    assert "# " in text
    assert "why" in text
    path.write_text(text.replace("EDC = {}", "EDC = { MCP = { constant = '1 mm' } }"))
    with pytest.raises(InputError, match="stands for all arms"):
        load_case(path)
    path.write_text(text.replace("EDC = {}\nLUM = {}", "LUM = {}\nEDC = {}"))
    with pytest.raises(InputError, match="expected the hood's muscles, LUM, EDC, FPI"):
        load_case(path)


def test_errors_are_relative_to_the_hood(samples, found):
    exact = reduction.errors(a_reduction(samples, found))
    assert all(e.most < 1e-8 for e in exact)
    tenth = a_reduction(samples, replace(found, energy=1.1 * found.energy))
    told = {e.quantity: e for e in reduction.errors(tenth)}
    assert told["joint torques"].most == pytest.approx(0.1, rel=1e-6)
    assert told["tip force"].median == pytest.approx(0.1, rel=1e-6)
    assert told["tip force"].mark == "5 %"
    off = np.abs(0.1 * reduction.stacked(samples[140:])["slip"])
    assert 0 < told["slip forces"].most <= off.max() / off.max(axis=1).min()


def test_the_tip_map_is_what_the_clamped_finger_bears():
    """tau + J^T r = 0 of a finger held at its tip: the force balances the torques that made it."""
    case = reduction.clamped(load_case("network_edc"))
    finger = build(case).finger
    angle = np.array([0.5, 0.0, 0.8, 0.3])
    state = finger.start(dict(zip(finger.joints, angle, strict=True)))
    made = reduction.tip_map(finger, angle)
    push = np.array([0.3, 0.1, -0.7])
    step = 1e-6
    tips = []
    for e in np.eye(len(finger.unknowns(state)))[:4]:
        ends = [finger.tip(finger.displaced(state, sign * step * e)) for sign in (1, -1)]
        tips.append((ends[0] - ends[1]) / (2 * step))
    torque = np.array(tips) @ push  # joint torques that press the tip with this force
    assert made @ torque == pytest.approx(push, rel=1e-6)


def test_loads_of_tendons_at_rest():
    case = load_case("fingertip_fibres_edc")
    loads = reduction.greatest_loads(case, ("EDC", "EI", "LUM", "FPI"))
    assert loads == pytest.approx({"EDC": 3.469, "EI": 3.547, "LUM": 2.504, "FPI": 3.094})
    with pytest.raises(InputError, match="loads no tendon"):
        reduction.greatest_loads(load_case("fingertip_fibres_fdp"), ("EDC", "EI"))


def test_a_grid_is_read_and_walked_to_and_fro():
    assert reduction.read_grid(["PIP=30,10"]) == {"PIP": (10.0, 30.0)}
    assert reduction.read_grid([]) == reduction_walks.GRID
    with pytest.raises(InputError, match="write JOINT=DEG"):
        reduction.read_grid(["PIP=a"])
    lines = reduction_walks._to_and_fro([(1.0, 2.0, 3.0), (5.0, 6.0)])
    assert len(np.unique(lines, axis=0)) == 6
    steps = np.abs(np.diff(lines, axis=0))
    assert ((steps > 0).sum(axis=1) == 1).all()


def within() -> reduction_walks.Within:
    grid = {"MCP": (0.0, 60.0), "DIP": (5.0, 35.0)}
    home, most = np.array([0.0, 0.02, 0.3, 0.0]), np.array([3.0, 0.6])
    return reduction_walks.Within(("MCP", "MCP_abduction", "PIP", "DIP"), home, grid, most, 0.05)


def test_states_between_the_grids_points_fill_its_box():
    made, walks = within(), reduction_walks.spread_walks(within())
    angle = np.degrees(np.concatenate([walk.angles for walk in walks]))
    assert angle.min(axis=0) == pytest.approx([0, 1.146, 17.19, 5], abs=2)
    assert angle.max(axis=0) == pytest.approx([60, 1.146, 17.19, 35], abs=2)
    assert (angle[:, 0] >= 0).all()
    assert (angle[:, 3] <= 35).all()
    loads = np.array([walk.tensions[0] for walk in walks])
    alone = (loads == 0.05).sum(axis=1) == 1
    assert len(np.unique(loads[alone], axis=0)) == 2
    assert (loads[~alone] <= 0.65 * made.most).all()
    assert len(np.unique(loads[~alone], axis=0)) == reduction_walks.MIXTURES


def test_held_states_are_none_of_those_fitted():
    fitted_to = [*reduction_walks.grid_walks(within()), *reduction_walks.spread_walks(within())]
    seen = np.concatenate([walk.angles for walk in fitted_to])
    for walk in reduction_walks.held_walks(within()):
        apart = np.abs(walk.angles[:, None] - seen).max(axis=2)
        assert apart.min() > 1e-6


def test_points_are_passed_from_one_to_the_nearest():
    made = reduction_walks._chained(np.array([[9.0, 9.0], [0.0, 0.0], [5.0, 5.0], [1.0, 0.0]]))
    assert made.tolist() == [[0, 0], [1, 0], [5, 5], [9, 9]]


def test_rows_in_parts_are_the_rows_at_once(samples, found, monkeypatch):
    monkeypatch.setattr("rigid.reduction.AT_ONCE", 37)
    data = Data(**reduction.stacked(samples[:140]))
    parted = reduced(data, found.joints, found.muscles, STRAIGHT)
    held = reduction.stacked(samples[140:])
    torque = parted.torques(held["angle"], held["tension"])
    assert torque == pytest.approx(held["torque"], rel=1e-8, abs=1e-10)


def test_a_grid_beyond_the_joints_is_refused():
    source = find_case("cable_edc")
    for grid, words in (
        ({"FOO": (1.0,)}, "unknown joint FOO"),
        ({"PIP": (500.0,)}, "0 to 110 deg"),
    ):
        with pytest.raises(InputError, match=words):
            reduction.reduce_case(source, (), grid, 1)


class Stuck:
    """A hood that finds no equilibrium beyond a PIP angle."""

    def __init__(self, hood, most: float) -> None:
        self.hood, self.most, self.tendons = hood, most, hood.tendons

    def __getattr__(self, name):
        return getattr(self.hood, name)

    def advance(self, state, motion, tension, dt):
        relative = motion.rotation[1].T @ motion.rotation[2]
        if np.arccos((np.trace(relative) - 1) / 2) > self.most:
            raise ConvergenceError("stuck")
        return self.hood.advance(state, motion, tension, dt)


def test_reducing_leaves_out_what_does_not_converge(monkeypatch, tmp_path):
    """The whole command, on a network in place of the shell."""
    models = soft_models()
    stuck = replace(models, hood=Stuck(models.hood, np.radians(50)))

    def in_this_process(source, settings, walks, jobs):
        for one in walks:
            yield list(on_models(stuck, one))

    monkeypatch.setattr(reduction, "build", lambda case: models)
    monkeypatch.setattr(reduction, "sampled", in_this_process)
    monkeypatch.setattr(reduction, "fitted", lambda d, *a: reduced(Data(**d), *a, Order(angle=2)))
    out = tmp_path / "made.toml"
    done = CliRunner().invoke(app, ["reduce", "fingertip_isotropic_edc", "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert "left out: 30/0/55/20 deg, EDC 3.47, LUM 0.05, FPI 0.05 N: stuck" in done.output
    case = load_case(out)
    assert isinstance(case.hood, NetworkHood)
    assert case.finger.tip.kind == "clamped"


def test_only_hoods_of_finite_elements_are_reduced():
    done = CliRunner().invoke(app, ["reduce", "network_edc"])
    assert done.exit_code == 2
    assert "nothing is gained" in done.output
    done = CliRunner().invoke(app, ["reduce", "cable_edc", "--grid", "TIP=1,2"])
    assert done.exit_code == 2
    assert "unknown joint TIP" in done.output


def test_a_walk_goes_on_from_the_last_posture_found():
    models = soft_models()
    stuck = replace(models, hood=Stuck(models.hood, 0.5))
    angle = np.array([[0, 0, 0.3, 0.1], [0, 0, 0.8, 0.1], [0, 0, 0.4, 0.1]])
    states = list(on_models(stuck, Walk(angle, np.full((2, 3), 8.0))))
    assert [isinstance(s, Lost) for s in states] == [False, False, True, True, False, False]


def test_a_walk_is_followed_in_small_steps(monkeypatch):
    models, seen = soft_models(), []
    pose = models.finger.motion

    def told(state):
        seen.append(models.finger.angles(state)[2])
        return pose(state)

    monkeypatch.setattr(models.finger, "motion", told)
    list(
        on_models(
            models, Walk(np.array([[0, 0, 0.3, 0.1], [0, 0, 0.9, 0.1]]), np.full((1, 3), 8.0))
        )
    )
    assert np.abs(np.diff(seen)).max() <= np.radians(10.0) + 1e-12
    assert seen[-1] == 0.9
