"""An environment of Gymnasium: its checks, the loop behind it, seeds, ends, several at once."""

import warnings

import numpy as np
import pytest

import cosim
from cosim.errors import ConvergenceError, InputError

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402

import cosim.gym  # noqa: E402

ADVICE = "Box action spaces|observation space m..imum value is|alternative render modes"
"""Not faults: observations have no bounds, tensions are not between -1 and 1."""


def reward(seen, action):
    """A number of both, by name."""
    return seen["tip_force.dorsal"] - 0.5 * sum(action.values())


def environment(case="network_edc", **keys):
    return cosim.gym.FingerEnv(case, **{"reward": reward, "duration": "20 ms", **keys})


@pytest.mark.parametrize("name", ["network_edc", "pneumatic_edc_fdp", "planar_edc"])
@pytest.mark.parametrize("spread", [0.0, "2 deg"])
def test_it_passes_the_check_of_gymnasium(name, spread):
    env = gymnasium.make("cosim/Finger-v0", case=name, reward=reward, spread=spread)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=rf"(?s).*({ADVICE})")
        check_env(env.unwrapped)


def test_it_steps_as_the_loop_does_and_rewards_by_the_users_function():
    names, observed = ("FDP", "EDC"), ("tension.FDP", "tip_force.dorsal", "angle.PIP")
    env, loop = environment(commanded=names, observed=observed), cosim.Loop("network_edc")
    seen, info = env.reset()
    assert (list(seen), info) == (list(observed), {})
    assert list(env.observation_space) == list(observed)
    assert {n: x.item() for n, x in seen.items()} == {n: loop.observe()[n] for n in observed}
    for k in range(10):
        action = np.array([0.2 * k, 1.0], dtype=np.float32)
        seen, gained, terminated, truncated, info = env.step(action)
        expected = loop.step(dict(zip(names, action, strict=True)))
        assert {n: x.item() for n, x in seen.items()} == {n: expected[n] for n in observed}
        assert gained == expected["tip_force.dorsal"] - 0.5 * float(action.astype(float).sum())
        assert (terminated, truncated, info) == (False, k == 9, {})
    assert env.reset()[0]["angle.PIP"] == loop.reset()["angle.PIP"]
    assert not env.step(action)[3]


def test_its_space_is_that_of_the_cases_limits():
    case = cosim.load("network_edc", ['tendons.FDP.max_force="0.1 N"'])
    env = environment(case)
    actions = env.loop.actions
    assert env.commanded == tuple(actions)
    assert env.action_space.low.tolist() == [c.least for c in actions.values()]
    assert env.action_space.high.tolist() == [c.most for c in actions.values()]
    assert env.action_space.high[env.commanded.index("FDP")] == 0.1
    env.step(env.action_space.high.astype(np.float32))  # 0.1 in single precision is above it


@pytest.mark.parametrize(
    "action",
    [[1.0], 1.0, np.ones((2, 1)), [1.0, np.nan], [1.0, -0.1], [1.0, 1e9], [1j, 1], [True, 1], "12"],
)
def test_an_action_outside_its_space_is_refused_and_nothing_moves(action):
    env = environment(commanded=["EDC", "FDP"])
    env.reset()
    before = env.loop.state
    with pytest.raises(InputError, match="action"):
        env.step(action)
    assert env.loop.state == before


def test_seeds_draw_where_episodes_begin():
    env, same = environment(spread="4 deg"), environment(spread=np.radians(4.0))
    begun = [env.reset(seed=5)[0], env.reset()[0], env.reset()[0]]
    again = [same.reset(seed=5)[0], same.reset()[0], same.reset()[0]]
    assert begun == again
    angles = [seen["angle.PIP"].item() for seen in begun]
    assert len(set(angles)) == 3
    middle = np.radians(45.0)
    many = [env.reset(seed=seed)[0]["angle.PIP"].item() - middle for seed in range(20)]
    assert 3.0 < np.degrees(np.abs(many).max()) <= 4.0
    bent = env.reset(seed=5, options={"posture": {"PIP": 1.0}, "action": {"EDC": 2.0}})[0]
    assert bent["angle.PIP"].item() - 1.0 == pytest.approx(angles[0] - middle)
    assert bent["tension.EDC"] == 2.0
    with pytest.raises(InputError, match="no wind; there are posture, action"):
        env.reset(options={"wind": 1.0})


def test_a_step_that_does_not_converge_ends_the_episode_where_it_stood(monkeypatch):
    def fail(*args: object) -> None:
        raise ConvergenceError("no equilibrium.")

    env = environment(failure_reward=-7.0, ends=lambda seen: seen["time"] > 3e-3)
    env.reset()
    before, _, ended, *_ = env.step(env.action_space.low)
    assert not ended
    with monkeypatch.context() as patch:
        patch.setattr(type(env.loop.models.hood), "advance", fail)
        seen, gained, terminated, _, info = env.step(env.action_space.low)
    assert (seen, gained, terminated) == (before, -7.0, True)
    assert "no equilibrium. The loop stands where it stood" in info["failure"]
    assert env.step(env.action_space.low)[2:] == (True, False, {})  # as the user says


def test_several_are_each_like_one_alone():
    keys = {"case": "network_edc", "reward": reward, "commanded": ("EDC",), "spread": "3 deg"}
    several = gymnasium.make_vec("cosim/Finger-v0", num_envs=3, vectorization_mode="sync", **keys)
    seen, _ = several.reset(seed=[1, 2, 3])
    after, gained, *_ = several.step(np.array([[0.5], [1.0], [1.5]]))
    for k, tension in enumerate((0.5, 1.0, 1.5)):
        env = cosim.gym.FingerEnv(**keys)
        alone, _ = env.reset(seed=k + 1)
        assert seen["angle.PIP"][k] == alone["angle.PIP"]
        alone, reward_alone, *_ = env.step([tension])
        assert (after["angle.PIP"][k], gained[k]) == (alone["angle.PIP"], reward_alone)
    several.close()


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"reward": 1.0}, "reward, ends: expected functions"),
        ({"ends": True}, "reward, ends: expected functions"),
        ({"commanded": ["EDCC"]}, "commanded: there is no EDCC; did you mean EDC"),
        ({"observed": ["angle.PPI"]}, r"observed: there is no angle\.PPI; did you mean"),
        ({"observed": [[1]]}, "observed: there is no"),
        ({"commanded": "EDC"}, "commanded: expected a list of different names"),
        ({"commanded": ["EDC", "EDC"]}, "commanded: expected a list of different names"),
        ({"observed": []}, "observed: expected a list of different names"),
        ({"duration": 0}, r"duration = 0: must be 0\.002 s or more"),
        ({"spread": -0.1}, "spread"),
        ({"spread": "2 mm"}, "spread"),
    ],
)
def test_what_cannot_be_is_refused_in_words(keys, words):
    with pytest.raises(InputError, match=words):
        environment(**keys)
