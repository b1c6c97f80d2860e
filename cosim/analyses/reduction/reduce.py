"""A network hood fitted to what a shell or a net of cables does, and how far it is off."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cosim.analyses.reduction.samples import (
    FREE,
    Walk,
    WalkSamples,
    kept_samples,
    sample_walks,
)
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
from cosim.models.build import Models, build
from cosim.number_text import read_number
from cosim.port import Array, Load, OpenFinger

BATCH = 20_000


class Rate(NamedTuple):
    """The times (s) that one state takes."""

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
    """The angles by joint, deg, that JOINT=DEG,DEG state; the default without any.  Raises
    InputError."""
    if not texts:
        return dict(GRID)
    return dict(_axis(text) for text in texts)


def _axis(text: str) -> tuple[str, tuple[float, ...]]:
    joint, _, values = text.partition("=")
    angles = {read_number(value) for value in values.split(",")}
    if None in angles:
        raise InputError(f"--grid {text!r}: write JOINT=DEG,DEG, for example PIP=10,35,60")
    return joint.strip(), tuple(sorted(angle for angle in angles if angle is not None))


def greatest_loads(case: Case, tendons: Sequence[str]) -> dict[str, float]:
    """The greatest load of each tendon of the hood, N: the case's; of one that rests there as large
    a part of its greatest force as the case's most active tendon has of its own, or the case's
    greatest load.

    Raises InputError for a case that loads none."""
    rest, loads = case.solve.resting_tension, {name: case.tension(name) for name in tendons}
    most = max(loads.values())
    if most <= rest:
        raise InputError(
            f"{case.name}: loads no tendon of the hood; give one of {', '.join(tendons)} a tension "
            "or an activation"
        )
    strength = {n: t.max_force for n, t in case.tendons.items() if t.max_force is not None}
    part = max((loads[n] / strength[n] for n in loads if n in strength), default=0.0)
    return {
        name: force if force > rest else part * strength[name] if name in strength else most
        for name, force in loads.items()
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
    _check_kinds(case)
    models = build(case)
    joints, tendons = models.finger.joints, models.hood.tendons
    loads = greatest_loads(case, tendons)
    within = _sample_range(case, models, grid, loads, spread)

    fitted = [*grid_walks(within), *spread_walks(within)]
    walks = [*fitted, *held_out_walks(within)]
    walked: list[WalkSamples] = []
    for walk in _sample(source, settings, walks, workers, samples):
        walked.append(walk)
        states = sum(len(w.states) for w in walked)
        failed = [s for w in walked for s in w.failures()]
        tell(f"walk {len(walked)}/{len(walks)}: {states} states, {len(failed)} failed")
    fit = tuple(s for w in walked[: len(fitted)] for s in w.samples())
    held = tuple(s for w in walked[len(fitted) :] for s in w.samples())
    failures = tuple(f"{state_in_words(s.angle, s.tension, tendons)}: {s.reason}" for s in failed)
    if not fit or not held:
        raise InputError(
            f"{case.name}: the hood found no equilibrium in any posture of the grid, or of those "
            f"held out ({failures[0] if failures else 'none'}); choose another --grid"
        )

    tell(f"fitting to {len(fit)} states")
    data = stack(fit)
    potential = reduce_hood(data, joints, tendons, maps=tip_maps(case, data.angle))
    seconds = sum(w.seconds for w in walked) / states
    rate = _rate(potential, fit, case)
    return Reduction(case, within, loads, potential, fit, held, failures, seconds, rate)


def _check_kinds(case: Case) -> None:
    """Check that the hood is worth reducing and that the finger takes the reduced one.  Raises
    InputError."""
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


def _sample_range(
    case: Case,
    models: Models,
    grid: Mapping[str, tuple[float, ...]],
    loads: Mapping[str, float],
    spread: int,
) -> SampleRange:
    """Where the case's hood is sampled.  Raises InputError for joints or angles that are none."""
    joints = models.finger.joints
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
    axes = {j: grid[j] for j in joints if j in grid}
    most = np.array(list(loads.values()))
    return SampleRange(joints, home, axes, most, case.solve.resting_tension, spread)


def _sample(
    source: Path, settings: Sequence[str], walks: Sequence[Walk], workers: int, kept: Path | None
) -> Iterator[WalkSamples]:
    """What each walk finds, in their order, with what the file `kept` has."""
    sampling = partial(sample_walks, source, settings, workers=workers)
    if kept is None:
        return sampling(walks)
    held_case = load_case(source, (*settings, FREE))
    return kept_samples(kept, address(held_case, code_version()), walks, sampling)


def state_in_words(angle: Array, tension: Array, tendons: Sequence[str]) -> str:
    """A state for messages: joint angles (n,) rad in the finger's order and tensions (m,) N."""
    posture = "/".join(f"{a:.3g}" for a in np.round(np.degrees(angle), 6) + 0.0)
    load = ", ".join(f"{n} {t:.3g}" for n, t in zip(tendons, tension, strict=True))
    return f"{posture} deg, {load} N"


def _rate(potential: ReducedPotential, samples: Sequence[Sample], case: Case) -> Rate:
    """Measure the potential's speed: states one by one behind the port, and a batch."""
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


def tip_maps(case: Case, angles: Array) -> Array:
    """The maps (s, 3, n) of the case's finger with its tip clamped, at angles (s, n) rad."""
    finger = live_finger(clamp_tip(case).native_finger(), case.hood.left_to_finger)
    return np.array([tip_map(finger, angle) for angle in angles])


def clamp_tip(case: Case) -> Case:
    """The case with its fingertip clamped."""
    finger = case.native_finger()
    tip = finger.tip.model_copy(update={"kind": "clamped"})
    return case.model_copy(update={"finger": finger.model_copy(update={"tip": tip})})


def tip_map(finger: OpenFinger, angle: Array) -> Array:
    """The force of a held fingertip on the world by torques about the joints (3, n), N/(N m)."""
    state = finger.start(dict(zip(finger.joints, map(float, angle), strict=True)))
    bodies, none = finger.bodies, np.zeros(len(finger.tendons))
    idle = Load(bodies, ("none",), np.zeros((len(bodies), 1, 6)), np.zeros((0, 6)))
    n, width = len(finger.joints), 6 * len(bodies)
    slope = finger.tangent(state, idle, none, np.zeros((width, width)))[:n, n:]
    steps = np.eye(n + slope.shape[1])[n:]
    force = np.array(
        [finger.balance(finger.displace(state, step), idle, none).tip_force for step in steps]
    ).T
    out: Array = -force @ np.linalg.pinv(slope)
    return out
