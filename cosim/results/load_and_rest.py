"""What a load changes, beside what the hood has at rest, and the warning where that is little.

At rest every tendon has its resting tension: the unloaded state of a run.  A hood in a hand is then
nearly without force.  A model of it need not be: its stress-free shape was laid in another posture,
and where it cannot glide to the new one it pushes and pulls without any load.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cosim.port import Array
from cosim.results.conventions import vector_of

LEAST_RATIO = 3.0
"""A load that changes a quantity by less than that many times its value at rest is warned of."""
LEAST_TENSION = 1.0
"""N in all tendons of the hood together: a load with less does not act through the hood."""
LEAST_FORCE, LEAST_TORQUE = 1e-6, 1e-3
"""N and N mm, below which nothing is there at rest."""
NAMES = {
    "fingertip_force_N": "fingertip force",
    "hood_torque_Nmm": "largest joint torque of the hood",
    "slip_force_N": "largest force of a slip",
}
UNITS = {"fingertip_force_N": "N", "hood_torque_Nmm": "N mm", "slip_force_N": "N"}
NO_TENDONS = "the hood has no tendons of its own"
NOT_PULLED = "the load pulls no tendon of the hood beyond its resting tension"
NO_UNLOADED = "a motion has no unloaded state"
LAID = (
    "The hood is not at rest when the finger is: the result depends on the posture in which the "
    "hood was laid free of stress, on extra lengths and on the slack of springs as much as on the "
    "load. In summary.json, joint_torque_Nmm.hood, spring_force_N and glide_mm under unloaded say "
    "where the hood is held."
)
LUMPED = (
    "The hood is not at rest when the finger is: the result depends on the lengths at which the "
    "hood's tendons are free of tension, and on solve.resting_tension, as much as on the load. In "
    "summary.json, joint_torque_Nmm.hood under unloaded says where the hood pulls."
)
NOT_THE_HOOD = (
    "More than by the hood it is pushed at rest by passive joints, gravity or the finger's own "
    "tendons (joint_torque_Nmm under unloaded in summary.json): the fingertip force under load "
    "depends on them as much as on the load."
)
UNKNOWN = (
    "Hood or finger pushes at rest: a finger in an FMU does not say which. The fingertip force "
    "under load depends on that as much as on the load."
)
SUPPORTS = ("fingertip", "holder")
"""Sources of joint torque that answer the others."""
Block = Mapping[str, Any]


def rest_block(loaded: Block, unloaded: Block, tendons: Sequence[str]) -> dict[str, Any]:
    """The block `rest` of a summary, from its two states and the names of the hood's tendons.

    Of the fingertip force, the hood's joint torques and the forces of the slips: `at_rest` the
    largest of the unloaded state, `change` the largest change from there to the loaded state.  What
    is zero in both states is left out.  `exempt` says why no warning can follow, where none can."""
    out: dict[str, Any] = {}
    for key, with_load, without_load in _figures(loaded, unloaded):
        at_rest, change = _largest(key, without_load), _largest(key, with_load - without_load)
        if at_rest > 0 or change > 0:
            out[key] = {"at_rest": at_rest, "change": change}
    if reason := _exemption(loaded, unloaded, tendons):
        out["exempt"] = reason
    return out


def _figures(loaded: Block, unloaded: Block) -> Iterator[tuple[str, Array, Array]]:
    """Key of a quantity, and its values (n,) in the two states."""
    states = (loaded, unloaded)
    with_load, without_load = (vector_of(state["fingertip_force_N"]) for state in states)
    yield "fingertip_force_N", with_load, without_load
    torques = [state.get("joint_torque_Nmm", {}).get("hood", {}) for state in states]
    slips = [state.get("slip_force_N", {}) for state in states]
    for key, tables in (("hood_torque_Nmm", torques), ("slip_force_N", slips)):
        with_load, without_load = (np.array(list(table.values()), dtype=float) for table in tables)
        if len(with_load):
            yield key, with_load, without_load


def _largest(key: str, values: Array) -> float:
    """The fingertip force's size; of joints and slips the largest."""
    if key == "fingertip_force_N":
        return float(np.linalg.norm(values))
    return float(np.abs(values).max())


def _exemption(loaded: Block, unloaded: Block, tendons: Sequence[str]) -> str:
    """Why the load is not judged by what there is at rest; empty where it is."""
    if not tendons:
        return NO_TENDONS
    pull, rest = (
        np.array([state["tension_N"][name] for name in tendons]) for state in (loaded, unloaded)
    )
    if pull.sum() < LEAST_TENSION:
        return f"the hood's tendons bear {pull.sum():.2g} N under load, less than {LEAST_TENSION:g}"
    return "" if (pull > rest).any() else NOT_PULLED


def little_beyond_rest(rest: Block) -> list[str]:
    """The keys of a block `rest` whose change is less than LEAST_RATIO times what is at rest; none
    where the case is exempt."""
    if "exempt" in rest:
        return []
    return [
        key
        for key in NAMES
        if key in rest
        and rest[key]["at_rest"] > (LEAST_TORQUE if key == "hood_torque_Nmm" else LEAST_FORCE)
        and rest[key]["change"] < LEAST_RATIO * rest[key]["at_rest"]
    ]


def rest_warnings(rest: Block, unloaded: Block, is_laid: bool) -> list[str]:
    """What to know of a load that changes little beside what there is at rest; empty otherwise.

    `is_laid`: the hood is a sheet or a net that was laid free of stress."""
    little = little_beyond_rest(rest)
    if not little:
        return []
    figures = "; ".join(f"{NAMES[key]} {describe_figures(rest, key)}" for key in little)
    meaning = LAID if is_laid else LUMPED
    if little == ["fingertip_force_N"]:
        torque = unloaded.get("joint_torque_Nmm")
        meaning = UNKNOWN if torque is None else meaning if _is_the_hoods(torque) else NOT_THE_HOOD
    return [
        f"the load adds little to what is there at rest (less than {LEAST_RATIO:g} times as much): "
        f"{figures}. {meaning}"
    ]


def _is_the_hoods(torque: Mapping[str, Mapping[str, float]]) -> bool:
    """Whether the hood makes the largest joint torque, of that and what all other sources but the
    supports make together; `torque`: by source and joint."""
    values = {source: np.array(list(by_joint.values())) for source, by_joint in torque.items()}
    others = [v for source, v in values.items() if source not in ("hood", *SUPPORTS)]
    return bool(np.abs(values["hood"]).max() >= np.abs(sum(others, np.zeros(1))).max())


def describe_figures(rest: Block, key: str) -> str:
    """What a quantity of a block `rest` has at rest, how much the load changes it, in words."""
    at_rest, change = rest[key]["at_rest"], rest[key]["change"]
    unit = UNITS[key]
    times = change / at_rest if at_rest > 0 else 0.0
    shown = f"{times:.0f}" if times >= 100 else f"{times:.2g}"
    ratio = f" ({shown} times)" if at_rest > 0 else ""
    return f"{at_rest:.3g} {unit} at rest, largest change under load {change:.3g} {unit}{ratio}"


def describe_rest(summary: Block) -> Iterator[tuple[str, str]]:
    """Name and words of each quantity of a summary's block `rest`, and why the case is exempt."""
    rest = summary.get("rest", {})
    for key, name in NAMES.items():
        if key in rest:
            yield name, describe_figures(rest, key)
    if "exempt" in rest:
        yield "load and rest", f"not judged: {rest['exempt']}"
