"""The loaded equilibrium beside the one that a second start leads to: where they differ, and by how
much energy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cosim.case.layers import nested
from cosim.coupling.equilibrium import Equilibrium
from cosim.models.build import Models
from cosim.port import Array
from cosim.results.audit import BOUNDS
from cosim.results.compare import numbers_of, unit_of
from cosim.results.conventions import by_axis, by_name
from cosim.solve.static import States

MOST_NAMED = 5
LITTLE = 0.01
"""In its own unit (N, N mm, mm, deg, %): a kind of quantity that is no larger is not compared."""
SAME_TENSION = 1e-9
"""N: of equilibria under other tensions the potentials cannot be compared."""
NOT_OF_THE_FINGER = ("hood", "fingertip", "holder")
"""Sources of joint torque that are counted with the hood, or that hold still."""


def second_start_differences(models: Models, states: States) -> dict[str, float]:
    """How far the loaded equilibrium is from that of the second start, zero where it has none."""
    finger, other = models.finger, states.second and states.second.found
    pair = [e.finger_state for e in (states.loaded, other or states.loaded)]
    force, angles = (
        np.subtract(*map(quantity, pair)) for quantity in (finger.tip_force, finger.angles)
    )
    return {
        "second_start_force_N": float(np.linalg.norm(force)),
        "second_start_angle_deg": float(np.rad2deg(np.abs(angles).max())),
    }


def second_start_block(
    models: Models,
    states: States,
    first: Mapping[str, Any],
    describe: Callable[[Equilibrium], Mapping[str, Any]],
) -> dict[str, Any]:
    """What the second start found: its fingertip force and posture; of another equilibrium than the
    `first` all that `describe` says of it, in what they differ most, and their energies."""
    if states.second is None:
        return {}
    out: dict[str, Any] = {"scheme": states.second.scheme}
    if (e := states.second.found) is None:
        return {"second_start": out}
    angles = np.rad2deg(models.finger.angles(e.finger_state))
    out["fingertip_force_N"] = by_axis(models.finger.tip_force(e.finger_state))
    out["posture_deg"] = by_name(models.finger.joints, angles)
    apart = second_start_differences(models, states)
    if all(value <= BOUNDS[name].most for name, value in apart.items()):
        return {"second_start": out}
    out |= describe(e)
    out["difference"] = largest_differences(first, out)
    return {"second_start": out | _energies(models, states.loaded, e)}


def largest_differences(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Second less first of the five numbers that differ most, as nested tables: one of each kind of
    quantity (the first key of its path), relative to the largest number of that kind."""
    numbers, others = numbers_of(first), numbers_of(second)
    by_kind: dict[str, list[str]] = {}
    for path in numbers:
        kind = path.split(".")[0]
        if path in others and kind not in BOUNDS and unit_of(path) != "1":
            by_kind.setdefault(kind, []).append(path)
    change = {p: others[p] - numbers[p] for paths in by_kind.values() for p in paths}
    worst = []
    for paths in by_kind.values():
        scale = max(LITTLE, *(abs(each[p]) for each in (numbers, others) for p in paths))
        path = max(paths, key=lambda p: abs(change[p]))
        worst.append((abs(change[path]) / scale, path))
    out: dict[str, Any] = {}
    for size, path in sorted(worst, reverse=True)[:MOST_NAMED]:
        out |= nested(path, change[path]) if size > 0 else {}
    return out


def _energies(models: Models, first: Equilibrium, second: Equilibrium) -> dict[str, Any]:
    """mJ: stored in the hood in either equilibrium, and by how much the total potential of the
    second is higher; none of a hood in closed form, no change under other tensions."""
    if models.built.energy is None:
        return {}
    stored = [1e3 * models.built.energy(e.response.state) for e in (first, second)]
    out: dict[str, Any] = {"hood_energy_mJ": by_name(("first", "second"), stored)}
    change = potential_change(models, first, second)
    return out if change is None else {**out, "potential_change_mJ": 1e3 * change}


def potential_change(models: Models, first: Equilibrium, second: Equilibrium) -> float | None:
    """The total potential (J) of the second equilibrium less that of the first: energy stored in
    the hood, less tension times excursion over the hood's tendons, less the work of the finger's
    own tendons, passive joints, limits and gravity on the way there.  None where it is not known,
    or the tensions are not the same."""
    pulls, others = (np.append(e.hood_tension, e.finger_tension) for e in (first, second))
    same = np.allclose(pulls, others, rtol=0, atol=SAME_TENSION)
    if models.built.energy is None or first.balance is None or not same:
        return None
    pull = first.hood_tension
    hood = [models.built.energy(e.response.state) - pull @ e.excursion for e in (first, second)]
    return float(hood[1] - hood[0] - _work_of_finger(models, first, second))


def _work_of_finger(models: Models, first: Equilibrium, second: Equilibrium) -> float:
    """The work (J) of the finger's own torques from one posture to another, which no way changes:
    along the straight one, by Gauss-Legendre's rule."""
    finger = models.finger
    start, end = (finger.angles(e.finger_state) for e in (first, second))
    place, weight = np.polynomial.legendre.leggauss(8)

    def own_torque(part: float) -> Array:
        state = finger.with_angles(first.finger_state, start + part * (end - start))
        torque = finger.balance(state, first.load, first.finger_tension).torque
        own = [t for source, t in torque.items() if source not in NOT_OF_THE_FINGER]
        return np.sum(own, axis=0)

    power = np.array([own_torque(part) for part in (1 + place) / 2]) @ (end - start)
    return float(weight @ power / 2)
