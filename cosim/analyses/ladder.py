"""One case climbed through hoods of growing detail: from a fixed split to a shell with fibres."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cosim.build.fit import check_fit
from cosim.build.models import Models
from cosim.case.file import load_case
from cosim.case.schema import Case, CaseFile, our_finger
from cosim.coupling.equilibrium import Equilibrium
from cosim.fingers.fmu import FmuFinger
from cosim.hoods.lumped.build import split_slips
from cosim.hoods.lumped.table import TwoBandHood
from cosim.hoods.shell.table import ShellHood
from cosim.hoods.split import SplitHood
from cosim.port import Array, ConvergenceError, CosimError, InputError
from cosim.processes import process_pool
from cosim.results.static import result
from cosim.solve.states import States
from cosim.solve.static import solve

Status = Literal["converged", "failed", "does not apply"]
RUNGS = {
    "split": "base/split",
    "two_band": "base/two_band",
    "network": "base/network",
    "cable": "base/cable",
    "isotropic shell": "base/isotropic_finger",
    "fibre shell": "base/index_finger",
}
"""From the coarsest to the finest, with the packaged case that states each hood."""
MIDDLE = "base/middle_hood"
"""States the shells of the middle finger."""


@dataclass(frozen=True)
class Rung:
    """What one hood says of the case."""

    name: str
    is_own: bool
    """Whether the hood is the one that the case states."""
    status: Status
    reason: str
    """Why there are no numbers; empty where there are."""
    wall: float
    """s, models and both equilibria."""
    summary: Mapping[str, Any]
    """As of a run."""
    slips: Mapping[str, float]
    """N, central and terminal; empty of a hood without slips."""
    excursions: Mapping[str, float]
    """mm, of the loaded tendons, loaded less unloaded."""


def climbed(source: Path, settings: Sequence[str], jobs: int) -> Iterator[Rung]:
    """The rungs of a case, in their order, in so many processes (1: in this one).

    Raises InputError for a case that is no equilibrium of a finger of ours."""
    case = load_case(source, settings)
    _check(case)
    with process_pool(jobs) as pool:
        yield from pool.in_order(partial(climb, source, tuple(settings)), rungs_of(case))


def _check(case: Case) -> None:
    if case.forward is not None:
        raise InputError(
            f"{case.name}: is a motion; a ladder compares equilibria. Leave out [forward]"
        )
    if isinstance(case.finger, FmuFinger):
        raise InputError(f"{case.name}: its finger is an FMU, which a ladder cannot look into")
    check_fit(case)


def rungs_of(case: Case) -> list[str]:
    """The ladder's, and before them the case's own where it is none of them."""
    own = own_rung(case)
    return [*RUNGS] if own in RUNGS else [own, *RUNGS]


def own_rung(case: Case) -> str:
    """The name of the rung on which the case stands."""
    if not isinstance(case.hood, ShellHood):
        return case.hood.kind
    isotropic = all(region.kind == "isotropic" for region in case.hood.regions.values())
    return "isotropic shell" if isotropic else "fibre shell"


def on_rung(case: Case, name: str) -> Case:
    """The case with the hood of a rung in place of its own, all else as it was."""
    if name == own_rung(case):
        return case
    return case.model_copy(update={"hood": _hood(case, name)})


def _hood(case: Case, name: str) -> object:
    base: CaseFile = load_case(RUNGS[name])
    hood = base.hood
    if isinstance(hood, ShellHood) and case.finger.kind == "middle":
        laid = load_case(MIDDLE).hood
        return laid.model_copy(update={"regions": hood.regions})
    if isinstance(hood, TwoBandHood) and case.finger.kind == "index":
        # The planar finger's flexors are the hood's; here they are the finger's own.
        mine = {name: arms for name, arms in hood.muscles.items() if name not in ("FDP", "FDS")}
        return hood.model_copy(update={"muscles": mine})
    return hood


def climb(source: Path, settings: tuple[str, ...], name: str) -> Rung:
    """One rung; a hood that does not fit the case or has no equilibrium is one too, with the
    reason."""
    case = load_case(source, settings)
    is_own, started = name == own_rung(case), time.perf_counter()

    def without(status: Status, error: CosimError) -> Rung:
        wall = time.perf_counter() - started
        return Rung(name, is_own, status, " ".join(str(error).split()), wall, {}, {}, {})

    try:
        here = on_rung(case, name)
        check_fit(here)
        models, states = solve(here)
    except InputError as error:
        return without("does not apply", error)
    except ConvergenceError as error:
        return without("failed", error)
    wall = time.perf_counter() - started
    summary = result(here, models, states, wall).summary
    slips, excursions = _slips(here, models, states.loaded), _excursions(models, states)
    return Rung(name, is_own, "converged", "", wall, summary, slips, excursions)


def _slips(case: Case, models: Models, e: Equilibrium) -> Mapping[str, float]:
    """N, central and terminal, where the hood has slips."""
    if models.slips is not None:
        return models.slips(e.response.state)
    if isinstance(case.hood, SplitHood):
        tension = dict(zip(models.finger.tendons, map(float, e.finger_tension), strict=True))
        return split_slips(our_finger(case), case.hood, tension)
    return {}


def _excursions(models: Models, states: States) -> dict[str, float]:
    """mm, of the tendons that pull more when loaded."""
    ends = [
        dict(zip(models.hood.tendons, e.excursion, strict=True))
        | dict(zip(models.finger.tendons, -models.finger.path_lengths(e.finger_state), strict=True))
        for e in (states.unloaded, states.loaded)
    ]
    change = np.concatenate([_tension(states.loaded), -_tension(states.unloaded)]).reshape(2, -1)
    pulled = np.array([*models.hood.tendons, *models.finger.tendons])[change.sum(axis=0) > 0]
    return {str(name): 1e3 * float(ends[1][name] - ends[0][name]) for name in pulled}


def _tension(e: Equilibrium) -> Array:
    return np.concatenate([e.hood_tension, e.finger_tension])
