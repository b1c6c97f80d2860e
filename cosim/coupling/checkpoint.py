"""Checkpoints of a coupled motion: all that it needs to continue, written whole or not at all.

A file of plain arrays (`cosim.coupling.state_arrays`), with the case that it belongs to as text:
nothing in it can build anything but the state of that case.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim.array_cache import DIGEST, read_arrays
from cosim.content_key import arrays_key
from cosim.coupling.motion import MotionFrame, MotionState
from cosim.coupling.state_arrays import Special, flatten, rebuild
from cosim.errors import InputError
from cosim.files import output_file
from cosim.port import Array

NAME = "checkpoint.npz"
MOST_BYTES = 64 << 30
FRAMES, SHAPES = "frames", "shapes"


@dataclass(frozen=True)
class MotionHistory:
    """A motion so far: its state, the frames and fingertip wrenches of the steps behind, and what
    the hood looked like at some of them."""

    moment: MotionState
    frames: Sequence[MotionFrame]
    tips: Sequence[Array]
    shapes: Sequence[Mapping[str, Array]] = ()
    """Arrays by name, the same of each, `time` (s) among them."""


def write_checkpoint(
    folder: Path, case: str, kept: MotionHistory, special: Special, code: str
) -> None:
    """Into `folder`, over an older one; `code` names the program that computed it.  Raises
    InputError where it cannot be written (a full disk leaves the older one as it was)."""
    arrays = flatten(kept.moment, special)
    arrays |= {f"{FRAMES}/{k}": v for k, v in _stack_frames(kept.frames, kept.tips).items()}
    for name in kept.shapes[0] if kept.shapes else ():
        arrays[f"{SHAPES}/{name}"] = np.array([shape[name] for shape in kept.shapes])
    arrays |= {"case": np.array(case), "code": np.array(code)}
    arrays[DIGEST] = np.array(arrays_key(NAME, arrays))
    with output_file(folder / NAME) as part, part.open("wb") as file:
        np.savez(file, **arrays)


def read_checkpoint(
    folder: Path, case: str, template: MotionHistory, special: Special
) -> tuple[MotionHistory, str]:
    """The motion that `write_checkpoint` left, of which `template` is the beginning, and the name
    of the program that computed it.

    Raises InputError for a file that is none, that is cut off or was changed, whose state this
    program does not have, or that belongs to another case."""
    path = folder / NAME
    try:
        arrays = read_arrays(path, NAME, MOST_BYTES)
    except FileNotFoundError:
        raise InputError(f"{path}: there is no checkpoint to go on from") from None
    except Exception as error:  # whatever zipfile, lzma, zlib and numpy raise of a spoilt file
        reason = str(error) or type(error).__name__
        raise InputError(f"{path}: is no whole checkpoint ({reason}); run the case anew") from error
    stated, code = (str(arrays.pop(key, "")) for key in ("case", "code"))
    if stated != case:
        raise InputError(f"{path}: belongs to another case than {folder / 'case.toml'} says")
    frame_arrays, seen = (_under(arrays, start) for start in (FRAMES, SHAPES))
    try:
        moment = rebuild(template.moment, arrays, special)
        frames, tips = _unstack_frames(frame_arrays)
        shapes = tuple({k: v[i] for k, v in seen.items()} for i in range(len(seen.get("time", ()))))
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise InputError(f"{path}: is no whole checkpoint ({error}); run the case anew") from error
    return MotionHistory(moment, frames, tips, shapes), code


def _under(arrays: dict[str, Any], start: str) -> dict[str, Any]:
    """The arrays whose paths begin so, by the rest of their paths; they are taken out."""
    names = [name for name in arrays if name.startswith(f"{start}/")]
    return {name.partition("/")[2]: arrays.pop(name) for name in names}


FIELDS = (
    "time",
    "angles",
    "rates",
    "tension",
    "excursion",
    "wrench",
    "total",
    "imbalance",
    "drive",
    "motors",
    "points",
    "grip",
    "friction",
    "joint_torques",
)
NUMBERS = ("residual", "energy")


def _stack_frames(frames: Sequence[MotionFrame], tips: Sequence[Array]) -> dict[str, Array]:
    out = {name: np.array([getattr(f, name) for f in frames]) for name in (*FIELDS, *NUMBERS)}
    return {**out, "tips": np.array(tips)}


def _unstack_frames(arrays: dict[str, Array]) -> tuple[tuple[MotionFrame, ...], tuple[Array, ...]]:
    frames = tuple(
        MotionFrame(
            time=float(arrays["time"][k]),
            angles=arrays["angles"][k],
            rates=arrays["rates"][k],
            tension=arrays["tension"][k],
            excursion=arrays["excursion"][k],
            wrench=arrays["wrench"][k],
            total=arrays["total"][k],
            imbalance=(float(arrays["imbalance"][k, 0]), float(arrays["imbalance"][k, 1])),
            residual=float(arrays["residual"][k]),
            energy=float(arrays["energy"][k]),
            drive=arrays["drive"][k],
            motors=arrays["motors"][k],
            points=arrays["points"][k],
            grip=arrays["grip"][k],
            friction=arrays["friction"][k],
            joint_torques=arrays["joint_torques"][k],
        )
        for k in range(len(arrays["time"]))
    )
    return frames, tuple(arrays["tips"])
