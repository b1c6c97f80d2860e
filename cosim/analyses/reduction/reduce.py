"""A network hood fitted to what a shell or a net of cables does, and how far it is off."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cosim.analyses.reduction.sample_cache import cached_samples
from cosim.analyses.reduction.samples import FREE, WalkSamples, sample_walks
from cosim.analyses.reduction.tip import tip_maps
from cosim.analyses.reduction.walks import (
    GRID,
    SPREAD,
    SampleRange,
    grid_walks,
    held_out_walks,
    spread_walks,
)
from cosim.case.cache_key import address, code_version
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import InputError, Progress, quiet
from cosim.fingers.common import Extensor
from cosim.fingers.kinds import anatomy_of, live_finger
from cosim.hoods.kinds import fitting_kinds
from cosim.hoods.lumped.build import (
    ReducedPotential,
    Sample,
    build_reduced_hood,
    reduce_hood,
    stack,
)
from cosim.models.build import build
from cosim.port import Array

BATCH = 20_000


class Rate(NamedTuple):
    """s for one state."""

    one: float
    """Load, excursions and derivatives behind the port."""
    batched: float
    """Torques and slips of many at once."""


@dataclass(frozen=True)
class Reduction:
    """What was fitted, to what, and what was held out."""

    case: Case
    within: SampleRange
    loads: Mapping[str, float]
    """N, the greatest of each tendon."""
    potential: ReducedPotential
    samples: tuple[Sample, ...]
    held_out: tuple[Sample, ...]
    failures: tuple[str, ...]
    """States without an equilibrium, with the reason."""
    seconds: float
    """s, of the hood for one state: of all walks, with the steps between postures and what was
    lost, in processes beside each other."""
    rate: Rate


def read_grid(texts: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """deg by joint, of JOINT=DEG,DEG; the default without any.  Raises InputError."""
    if not texts:
        return dict(GRID)
    return dict(_axis(text) for text in texts)


def _axis(text: str) -> tuple[str, tuple[float, ...]]:
    joint, _, values = text.partition("=")
    try:
        angles = tuple(sorted({float(value) for value in values.split(",")}))
    except ValueError:
        angles = ()
    if not angles or not np.isfinite(angles).all():
        raise InputError(f"--grid {text!r}: write JOINT=DEG,DEG, for example PIP=10,35,60")
    return joint.strip(), angles


def greatest_loads(case: Case, tendons: Sequence[str]) -> dict[str, float]:
    """N of each tendon of the hood: the case's; of one that rests there as large a part of its
    greatest force as the case's most active tendon has of its own, or the case's greatest load.

    Raises InputError for a case that loads none."""
    rest, own = case.solve.resting_tension, {name: case.tension(name) for name in tendons}
    most = max(own.values())
    if most <= rest:
        raise InputError(
            f"{case.name}: loads no tendon of the hood; give one of {', '.join(tendons)} a tension "
            "or an activation"
        )
    strength = {n: t.max_force for n, t in case.tendons.items() if t.max_force is not None}
    part = max((own[n] / strength[n] for n in own if n in strength), default=0.0)
    return {
        name: force if force > rest else part * strength[name] if name in strength else most
        for name, force in own.items()
    }


def reduce_case(
    source: Path,
    settings: Sequence[str],
    grid: Mapping[str, tuple[float, ...]],
    workers: int,
    tell: Progress = quiet,
    spread: int = SPREAD,
    samples: Path | None = None,
) -> Reduction:
    """Sample the case's hood on the grid and off it (`spread` as of `SampleRange`), and fit; what
    the file `samples` has is read from there, and the rest kept there as it comes.

    Raises InputError for a hood in closed form, an unknown joint, too few samples, or a file that
    holds others."""
    case = load_case(source, settings)
    if not case.hood.lies_on_bones:
        raise InputError(
            f'{case.name}: hood.kind = "{case.hood.kind}" is not solved by finite elements, so '
            "that nothing is gained by reducing it; take a case with a shell or cables"
        )
    if "network" not in fitting_kinds(case.finger.kind):
        raise InputError(
            f'{case.name}: finger.kind = "{case.finger.kind}" takes no network hood, which is what '
            "a reduced hood is"
        )
    models = build(case)
    joints, tendons = models.finger.joints, models.hood.tendons
    if unknown := [joint for joint in grid if joint not in joints]:
        raise InputError(
            f"--grid: unknown joint {unknown[0]}; expected some of {', '.join(joints)}"
        )
    for joint, angles in grid.items():
        low, high = np.degrees(models.finger.ranges[joint])
        if beyond := [angle for angle in angles if not low <= angle <= high]:
            raise InputError(
                f"--grid: {joint} = {beyond[0]:g} deg: the joint goes from {low:g} to {high:g} deg"
            )
    home = np.array([models.posture.get(joint, 0.0) for joint in joints])
    loads = greatest_loads(case, tendons)
    most, rest = np.array(list(loads.values())), case.solve.resting_tension
    axes = {j: grid[j] for j in joints if j in grid}
    within = SampleRange(joints, home, axes, most, rest, spread)
    on_grid = [*grid_walks(within), *spread_walks(within)]
    off_grid = held_out_walks(within)
    found: list[WalkSamples] = []
    walks = [*on_grid, *off_grid]
    sampling = partial(sample_walks, source, settings, workers=workers)
    if samples is None:
        walking = sampling(walks)
    else:
        held_case = load_case(source, (*settings, FREE))
        walking = cached_samples(samples, address(held_case, code_version()), walks, sampling)
    for walked in walking:
        found.append(walked)
        states = [s for w in found for s in w.states]
        failed = [s for w in found for s in w.failures()]
        tell(f"walk {len(found)}/{len(walks)}: {len(states)} states, {len(failed)} failed")
    fit = tuple(s for w in found[: len(on_grid)] for s in w.samples())
    held = tuple(s for w in found[len(on_grid) :] for s in w.samples())
    failures = tuple(f"{state_in_words(s.angle, s.tension, tendons)}: {s.reason}" for s in failed)
    if not fit or not held:
        raise InputError(
            f"{case.name}: the hood found no equilibrium in any posture of the grid, or of those "
            f"held out ({failures[0] if failures else 'none'}); choose another --grid"
        )
    tell(f"fitting to {len(fit)} states")
    data = stack(fit)
    potential = reduce_hood(data, joints, tendons, maps=tip_maps(case, data.angle))
    rate = _rate(potential, fit, case)
    seconds = sum(w.seconds for w in found) / len(states)
    return Reduction(case, within, loads, potential, fit, held, failures, seconds, rate)


def state_in_words(angle: Array, tension: Array, tendons: Sequence[str]) -> str:
    """Joint angles (n,) in the finger's order and tensions (m,)."""
    posture = "/".join(f"{a:.3g}" for a in np.round(np.degrees(angle), 6) + 0.0)
    load = ", ".join(f"{n} {t:.3g}" for n, t in zip(tendons, tension, strict=True))
    return f"{posture} deg, {load} N"


def _rate(potential: ReducedPotential, samples: Sequence[Sample], case: Case) -> Rate:
    """Measured: states one by one behind the port, and a batch."""
    finger = live_finger(case.native_finger(), case.hood.left_to_finger)
    model = anatomy_of(case.finger, Extensor()).model
    hood = build_reduced_hood(potential, model, finger.bodies)
    named = [dict(zip(finger.joints, map(float, s.angle), strict=True)) for s in samples]
    motions = [finger.motion(finger.start(posture)) for posture in named]
    state, started = hood.start(motions[0]), time.perf_counter()
    for motion, s in zip(motions, samples, strict=True):
        hood.jacobian(hood.advance(state, motion, s.tension, np.inf).state)
    one = (time.perf_counter() - started) / len(samples)
    data, pick = stack(samples), np.arange(BATCH) % len(samples)
    angle, tension = data.angle[pick], data.tension[pick]
    started = time.perf_counter()
    potential.slips(angle, potential.torques(angle, tension))
    return Rate(one, (time.perf_counter() - started) / BATCH)
