"""What a hood does on bones held in many postures, under many loads: the data of a reduction.

A solve on held bones says, with the tangent of its state, the gradient of the hood's potential in
joint angles and tensions (torques and excursions) and its second derivatives.

Samples are kept in a file as they come, so that a reduction that was cut off goes on where it was,
and another fit to the same hood samples only what is new.  The file is JSON: the address of the
case, and for each walk, named by the hash of its postures and loads, what it found.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cosim.case.file import load_case
from cosim.errors import ConvergenceError, InputError
from cosim.files import write_text
from cosim.hoods.lumped.build import Sample
from cosim.models.build import Models, build
from cosim.outcome import one_line
from cosim.port import STATIC, Array, Load, State
from cosim.processes import process_pool

FREE = 'finger.tip.kind="free"'
"""The bones are held where they are put, whatever holds the case's fingertip."""
MOST_STEP = float(np.radians(10.0))
"""A hood follows the bones in steps of at most this turn."""
MOST_BYTES = 1 << 30
"""A larger file is none of samples."""
SHAPES = ("n", "m", "n", "m", "nn", "nm", "mm", "s")
"""The shapes of a sample's fields, in their order, for n joints, m tendons and s = 2 slips."""


@dataclass(frozen=True)
class FailedSample:
    """A state in which the hood found no equilibrium."""

    angle: Array
    tension: Array
    reason: str


@dataclass(frozen=True)
class Walk:
    """Postures to pass through, and in each its loads, the first of them on the way there."""

    angles: Array
    """(p, n) rad."""
    tensions: Array
    """(p, k, m) N, or (k, m) for all postures alike."""

    def stops(self) -> Iterator[tuple[Array, Array]]:
        """Angles (n,) and loads (k, m), posture by posture."""
        each = (len(self.angles), *self.tensions.shape[-2:])
        return zip(self.angles, np.broadcast_to(self.tensions, each), strict=True)


class WalkSamples(NamedTuple):
    """What a walk found."""

    states: list[Sample | FailedSample]
    seconds: float
    """s it took, in a process beside others."""

    def samples(self) -> list[Sample]:
        """The states in equilibrium, in the walk's order."""
        return [state for state in self.states if isinstance(state, Sample)]

    def failures(self) -> list[FailedSample]:
        """The states without equilibrium, in the walk's order."""
        return [state for state in self.states if isinstance(state, FailedSample)]


def sample_walks(
    source: Path, settings: Sequence[str], walks: Sequence[Walk], workers: int
) -> Iterator[WalkSamples]:
    """What each walk found, in their order, in so many processes (1: in this one)."""
    with process_pool(workers) as pool:
        yield from pool.in_order(partial(sample_walk, source, tuple(settings)), walks)


def sample_walk(source: Path, settings: tuple[str, ...], walk: Walk) -> WalkSamples:
    """One walk on the models of a case, which a process builds once."""
    models, started = _models(source, settings), time.perf_counter()
    states = list(on_models(models, walk))
    return WalkSamples(states, time.perf_counter() - started)


@lru_cache(maxsize=1)
def _models(source: Path, settings: tuple[str, ...]) -> Models:
    return build(load_case(source, (*settings, FREE)))


def on_models(models: Models, walk: Walk) -> Iterator[Sample | FailedSample]:
    """Every load in every posture that can be reached; where the first load fails the walk
    goes on from the last posture that was found."""
    at = walk.angles[0]
    state = models.hood.start(models.finger.motion(_place(models, at)))
    for angle, loads in walk.stops():
        try:
            state = _move_hood(models, state, at, angle, loads[0])
            at = angle
        except ConvergenceError as error:
            yield from (FailedSample(angle, load, one_line(error)) for load in loads)
            continue
        yield from _load_in_posture(models, state, angle, loads)


def _load_in_posture(
    models: Models, state: State, angle: Array, tensions: Iterable[Array]
) -> Iterator[Sample | FailedSample]:
    """One load after the other in a posture."""
    for tension in tensions:
        try:
            sampled, state = sample(models, state, angle, tension)
        except ConvergenceError as error:
            yield FailedSample(angle, tension, one_line(error))
            continue
        yield sampled


def _place(models: Models, angle: Array) -> State:
    return models.finger.start(dict(zip(models.finger.joints, map(float, angle), strict=True)))


def _move_hood(models: Models, state: State, start: Array, end: Array, tension: Array) -> State:
    """The hood's state at joint angles `end`, followed there from `start` (rad)."""
    pieces = max(1, int(np.ceil(np.abs(end - start).max() / MOST_STEP)))
    for part in np.arange(1, pieces + 1) / pieces:
        motion = models.finger.motion(_place(models, start + part * (end - start)))
        state = models.hood.advance(state, motion, tension, STATIC).state
    return state


def sample(models: Models, state: State, angle: Array, tension: Array) -> tuple[Sample, State]:
    """The hood under tensions (m,) N at joint angles (n,) rad, from a state near it; and its new
    state.  Raises ConvergenceError."""
    finger, hood = models.finger, models.hood
    posed = _place(models, angle)
    response = hood.advance(state, finger.motion(posed), tension, STATIC)
    slope, twist = hood.jacobian(response.state), finger.jacobian(posed)
    none, bodies = np.zeros(len(finger.tendons)), finger.bodies
    idle = Load(bodies, ("none",), np.zeros((len(bodies), 1, 6)), np.zeros((0, 6)))
    with_hood = finger.tangent(posed, response.load, none, slope.load_motion)
    without = finger.tangent(posed, idle, none, np.zeros_like(slope.load_motion))
    n = len(finger.joints)
    sampled = Sample(
        angle,
        tension,
        twist.T @ response.load.total().ravel(),
        response.excursion,
        (with_hood - without)[:n, :n],
        twist.T @ slope.load_tension,
        slope.excursion_tension,
        _slips(models, response.state),
    )
    return sampled, response.state


def _slips(models: Models, state: State) -> Array:
    if models.built.slips is None:
        return np.full(2, np.nan)
    forces = models.built.slips(state)
    return np.array([forces["central"], forces["terminal"]])


def kept_samples(
    path: Path,
    address: str,
    walks: Sequence[Walk],
    sample: Callable[[Sequence[Walk]], Iterator[WalkSamples]],
) -> Iterator[WalkSamples]:
    """What each walk found, in their order: read from `path`, or else sampled and written there.

    Raises InputError for a file of another case, or of another kind."""
    kept = _read(path, address) if path.exists() else {}
    names = [_name(walk) for walk in walks]
    new = sample([walk for walk, name in zip(walks, names, strict=True) if name not in kept])
    for walk, name in zip(walks, names, strict=True):
        if name in kept:
            yield _read_walk(path, walk, kept[name])
            continue
        walked = next(new)
        states = [{k: np.asarray(v).tolist() for k, v in asdict(s).items()} for s in walked.states]
        kept[name] = {"seconds": walked.seconds, "found": states}
        write_text(path, json.dumps({"case": address, "walks": kept}))
        yield walked


def _name(walk: Walk) -> str:
    digest = hashlib.sha256()
    for array in (walk.angles, walk.tensions):
        digest.update(f"{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _read(path: Path, address: str) -> dict[str, Any]:
    """What a file keeps of each walk by its name.  Raises InputError."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"{path}: larger than 1 GB, which no file of samples is")
        content = json.loads(path.read_text(encoding="utf-8"))
        case, walks = content["case"], dict(content["walks"])
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise InputError(
            f"{path}: is no file of samples that `cosim export --samples` wrote; choose another"
        ) from error
    if case != address:
        raise InputError(
            f"{path}: holds samples of another case, or by another version of this program or its "
            "libraries; choose another file"
        )
    return walks


def _read_walk(path: Path, walk: Walk, kept: Any) -> WalkSamples:
    """Read a walk.  Raises InputError for what is none of this size."""
    size = {"n": walk.angles.shape[-1], "m": walk.tensions.shape[-1], "s": 2}
    try:
        states = [_read_state(size, values) for values in kept["found"]]
        return WalkSamples(states, float(kept["seconds"]))
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(
            f"{path}: the samples of a walk are damaged ({error}); choose another file"
        ) from error


def _read_state(size: dict[str, int], kept: Any) -> Sample | FailedSample:
    """Read a state.  Raises ValueError, TypeError, KeyError for what is none of this size."""
    failed, arrays = "reason" in kept, []
    for field, letters in list(zip(fields(Sample), SHAPES, strict=True))[: 2 if failed else None]:
        array = np.array(kept[field.name], dtype=float)
        if array.shape != (shape := tuple(size[letter] for letter in letters)):
            raise ValueError(f"{field.name} has the shape {array.shape}, not {shape}")
        if field.name != "slip" and not np.isfinite(array).all():
            raise ValueError(f"{field.name} is not finite")
        arrays.append(array)
    return FailedSample(arrays[0], arrays[1], kept["reason"]) if failed else Sample(*arrays)
