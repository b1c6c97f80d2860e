"""Samples of a reduction kept in a file as they come, so that one that was cut off goes on where it
was, and another fit to the same hood samples only what is new.

The file is JSON: the address of the case, and for each walk, named by the hash of its postures and
loads, what it found.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from cosim.analyses.reduction.samples import FailedSample, Walk, WalkSamples
from cosim.errors import InputError
from cosim.files import output_file
from cosim.hoods.lumped.build import Sample

Sampler = Callable[[Sequence[Walk]], Iterator[WalkSamples]]
MOST_BYTES = 1 << 30


def cached_samples(
    path: Path, address: str, walks: Sequence[Walk], sample: Sampler
) -> Iterator[WalkSamples]:
    """What each walk found, in their order: read from `path`, or else sampled and written there.

    Raises InputError for a file of another case, or of another kind."""
    had = _read(path, address) if path.exists() else {}
    names = [_name(walk) for walk in walks]
    new = sample([walk for walk, name in zip(walks, names, strict=True) if name not in had])
    for walk, name in zip(walks, names, strict=True):
        if name in had:
            yield _read_walk(path, walk, had[name])
            continue
        found = next(new)
        had[name] = {"seconds": found.seconds, "found": [_state_key(s) for s in found.states]}
        with output_file(path) as part:
            part.write_text(json.dumps({"case": address, "walks": had}), encoding="utf-8")
        yield found


def _name(walk: Walk) -> str:
    digest = hashlib.sha256()
    for array in (walk.angles, walk.tensions):
        digest.update(f"{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _state_key(state: Sample | FailedSample) -> dict[str, Any]:
    return {name: np.asarray(value).tolist() for name, value in asdict(state).items()}


def _read(path: Path, address: str) -> dict[str, Any]:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"{path}: larger than 1 GB, which no file of samples is")
        told = json.loads(path.read_text(encoding="utf-8"))
        case, walks = told["case"], dict(told["walks"])
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise InputError(
            f"{path}: is no file of samples that `cosim reduce --samples` wrote; choose another"
        ) from error
    if case != address:
        raise InputError(
            f"{path}: holds samples of another case, or by another version of this program or its "
            "libraries; choose another file"
        )
    return walks


def _read_walk(path: Path, walk: Walk, told: Any) -> WalkSamples:
    shapes = _shapes(walk)
    try:
        states = [_state(shapes, values) for values in told["found"]]
        return WalkSamples(states, float(told["seconds"]))
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(
            f"{path}: the samples of a walk are damaged ({error}); choose another file"
        ) from error


def _shapes(walk: Walk) -> dict[str, tuple[int, ...]]:
    n, m = walk.angles.shape[-1], walk.tensions.shape[-1]
    return {
        "angle": (n,),
        "tension": (m,),
        "torque": (n,),
        "excursion": (m,),
        "stiffness": (n, n),
        "arms": (n, m),
        "compliance": (m, m),
        "slip": (2,),
    }


def _state(shapes: dict[str, tuple[int, ...]], told: Any) -> Sample | FailedSample:
    """Raises ValueError, TypeError, KeyError for what is no state of these shapes."""
    arrays = {}
    for name in ("angle", "tension") if "reason" in told else [f.name for f in fields(Sample)]:
        arrays[name] = np.array(told[name], dtype=float)
        if arrays[name].shape != shapes[name]:
            raise ValueError(f"{name} has the shape {arrays[name].shape}, not {shapes[name]}")
        if name != "slip" and not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name} is not finite")
    if "reason" in told:
        return FailedSample(arrays["angle"], arrays["tension"], str(told["reason"]))
    return Sample(**arrays)
