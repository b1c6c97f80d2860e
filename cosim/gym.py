"""A finger and its hood as an environment of Gymnasium, for a learner.

    import gymnasium
    import cosim.gym  # which registers it

    env = gymnasium.make("cosim/Finger-v0", case="network_edc", reward=reward)
    several = gymnasium.make_vec("cosim/Finger-v0", num_envs=4, case="network_edc", reward=reward)

Needs `pip install '.[gym]'`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.arguments import (
    by_name,
    by_name_or_in_order,
    is_several,
    quantity_in_si,
    real_number,
)
from cosim.errors import ConvergenceError, InputError, nearest_names, unexpected
from cosim.extras import require
from cosim.loop import Action, Loop
from cosim.port import Array
from cosim.schema import units

require("an environment of Gymnasium", "gymnasium")

import gymnasium  # noqa: E402  after the sentence that says how to install it
from gymnasium import spaces  # noqa: E402

if TYPE_CHECKING:
    from cosim.face import AnyCase

ID = "cosim/Finger-v0"
OPTIONS = ("posture", "action")
SLACK = 1e-6
"""The part of a bound's size by which rounding to single precision may lead beyond it."""
Observation = dict[str, Any]
"""Arrays (1,) by name."""
Reward = Callable[[Mapping[str, float], Mapping[str, float]], float]
"""The reward for what is observed after a step, and for the action, both by name."""


class FingerEnv(gymnasium.Env[Observation, Array]):
    """A `cosim.Loop` as an environment.

    `reward`: a function of what is observed after a step and of the action, two dicts of numbers by
    name.  `ends`: a function of what is observed that says whether the episode ends there.
    `duration`: s, or a text with its unit, after which an episode is cut off.  `commanded` and
    `observed`: names of `Loop.actions` and `Loop.observations`; without them all.  `spread`: rad,
    or a text with its unit, by which each joint begins at random off the posture at most.

    The action space is a box of the commanded tendons, each from its least to its greatest value of
    the case (`tendons.EDC.max_force` and the like); what is not commanded stays as the case has it.
    Observations are arrays (1,) by name, in SI units, in the loop's order.  A step that does not
    converge ends the episode where it stood, with `failure_reward`, and info["failure"] says why.

    `reset` takes a posture and an action as `Loop.reset` does: options={"posture": {"PIP": 0.5}}.

    >>> env = FingerEnv("split_edc", lambda seen, action: -seen["rate.PIP"] ** 2,
    ...                 commanded=["EDC", "FDP"], observed=["angle.PIP"])
    >>> env.action_space.shape, env.observation_space["angle.PIP"].shape
    ((2,), (1,))
    >>> seen, info = env.reset(seed=1)
    >>> seen, reward, terminated, truncated, info = env.step(np.array([2.0, 1.0]))
    >>> reward < 0.0, terminated, truncated, info
    (True, False, False, {})

    Raises InputError."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  as the class above has it

    def __init__(
        self,
        case: AnyCase,
        reward: Reward,
        *,
        step: float | str = "2 ms",
        substeps: int = 1,
        duration: float | str = "1 s",
        commanded: Sequence[str] | None = None,
        observed: Sequence[str] | None = None,
        spread: float | str = 0.0,
        ends: Callable[[Mapping[str, float]], bool] | None = None,
        failure_reward: float = 0.0,
    ) -> None:
        if not callable(reward) or not (ends is None or callable(ends)):
            raise unexpected("reward, ends", "functions", (reward, ends))
        self.loop = Loop(case, step, substeps=substeps)
        self.commanded = _chosen("commanded", commanded, self.loop.actions)
        self.observed = _chosen("observed", observed, self.loop.observations)
        seconds = quantity_in_si("duration", duration, units.TIME, self.loop.dt)
        self.steps = math.ceil(seconds / self.loop.dt - SLACK)
        self.spread = quantity_in_si("spread", spread, units.ANGLE, 0.0)
        self.reward, self.ends, self.failure_reward = reward, ends, failure_reward
        channels = [self.loop.actions[name] for name in self.commanded]
        low, high = (np.array([getattr(c, end) for c in channels]) for end in ("least", "most"))
        self.action_space = self._box = spaces.Box(low, high, dtype=np.float64)
        one = {name: spaces.Box(-np.inf, np.inf, (1,), np.float64) for name in self.observed}
        self.observation_space = spaces.Dict(list(one.items()))  # a list keeps its order
        self._done = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; where joints begin at random, `seed` says how from then on.

        Raises InputError, and ConvergenceError where the hood finds no equilibrium."""
        super().reset(seed=seed)
        given = by_name("options", {} if options is None else options, '{"posture": {"PIP": 0.5}}')
        if unknown := [name for name in given if name not in OPTIONS]:
            raise InputError(f"options: no {unknown[0]}; there are {', '.join(OPTIONS)}")
        drawn: dict[str, Any] = {}
        if self.spread > 0.0:
            drawn = {"seed": int(self.np_random.integers(2**63)), "spread": self.spread}
        seen = self.loop.reset(**given, **drawn)
        self._done = 0
        return self._observation(seen), {}

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Let a step pass under an action (n,), in the order of `commanded`.

        Raises InputError for an action that is not in the action space."""
        asked = self._by_name(action)
        self._done += 1
        over = self._done >= self.steps
        try:
            seen = self.loop.step(asked)
        except ConvergenceError as error:
            here = self._observation(self.loop.observe())
            return here, float(self.failure_reward), True, over, {"failure": str(error)}
        ended = self.ends is not None and bool(self.ends(seen))
        return self._observation(seen), float(self.reward(seen, asked)), ended, over, {}

    def _by_name(self, action: Action) -> dict[str, float]:
        """The action by name, within its bounds where rounding led beyond them."""
        names, box = ", ".join(self.commanded), self._box
        given = by_name_or_in_order("action", action, self.commanded, '{"EDC": 3.0}')
        numbers = np.array([real_number(given.get(name)) for name in self.commanded])
        inside = np.clip(numbers, box.low, box.high)
        is_near = (np.abs(inside - numbers) <= SLACK * (1.0 + np.abs(box.high))).all()
        if not is_near or len(given) > len(numbers):
            raise unexpected("action", f"numbers in {box} for {names}", action)
        return dict(zip(self.commanded, inside.tolist(), strict=True))

    def _observation(self, seen: Mapping[str, float]) -> Observation:
        return {name: np.array([seen[name]]) for name in self.observed}


def _chosen(place: str, given: object, known: Iterable[str]) -> tuple[str, ...]:
    """The names that are chosen, all without a choice.  Raises InputError."""
    if given is None:
        return tuple(known)
    names = tuple(map(str, given)) if is_several(given) else ()
    if not names or len(set(names)) < len(names):
        raise unexpected(place, "a list of different names", given)
    for name in names:
        if name not in known:
            near = nearest_names(name, known)
            hint = f"; did you mean {near[0]}?" if near else "."
            raise InputError(f"{place}: there is no {name}{hint} There are {', '.join(known)}")
    return names


gymnasium.register(ID, entry_point="cosim.gym:FingerEnv")
