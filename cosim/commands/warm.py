"""`cosim info --warm`: compile and bake ahead what a first run would."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
import typer

from cosim.array_cache import user_cache
from cosim.case.file import load_case
from cosim.commands.terminal import stages
from cosim.errors import InputError
from cosim.files import shown_path
from cosim.kernels.kernel import compiled_kernels
from cosim.models.build import build_any
from cosim.pipeline import run_case
from fe_solver.surfaces.spline_distance import SplineDistance


class Warmup(NamedTuple):
    """A shipped case that is built, and what is solved of it for the kernels that this calls."""

    what: str
    case: str
    settings: Mapping[str, Any] = {}
    solve: Literal["nothing", "hood at rest", "case"] = "nothing"


MESH = {"hood.mesh.quads": 120, "solve.hood_tolerance": 0.01}
NINE_NODES = {**MESH, "hood.mesh.elements": "quadratic"}
SHORT = {"forward.duration": "2 ms", "forward.must_rest": False}
WARMUPS = (
    Warmup("four-node shells", "isometric_edc", MESH, "hood at rest"),
    Warmup("nine-node shells", "isometric_edc", NINE_NODES, "hood at rest"),
    Warmup("fingers at rest", "split_edc", {}, "case"),
    Warmup("fingers in motion", "forward_edc", SHORT, "case"),
    Warmup("hoods of joint angles", "network_edc", {}, "case"),
    Warmup("bones of the middle finger", "hood_majorflex_edc"),
    Warmup("bones of the ring finger", "ring_edc"),
    Warmup("bones of the little finger", "little_edc"),
    Warmup("links of the robotic finger", "robot_cable_extensor"),
    Warmup("bones of an anatomy of one's own", "own_edc"),
)
"""They call every kernel that the shipped cases do, and lie on all bones of theirs."""


def warm_everything() -> None:
    """Compile the kernels and bake the distances of the bones that the shipped cases need, and tell
    where they are kept."""
    started = time.perf_counter()
    with stages("warm", len(WARMUPS) + 1) as progress:
        progress.begin("distances of a surface")
        _bake_tetrahedron()
        _check_kept()
        for warmup in WARMUPS:
            progress.begin(warmup.what)
            _warm_up(warmup)
        _check_kept()
    kernels = list(compiled_kernels())
    compiled, loaded = sum(k.compiled for k in kernels), sum(k.loaded for k in kernels)
    seconds = time.perf_counter() - started
    typer.echo(f"{compiled} kernels compiled and {loaded} found compiled, in {seconds:.0f} s")
    for folder in sorted({k.folder for k in kernels if k.folder is not None}):
        typer.echo(f"kernels are kept in {shown_path(folder)}")
    typer.echo(f"distances of bones are kept {_bones_folder()}")


def _check_kept() -> None:
    """Check that every kernel that was compiled could be kept.  Raises InputError."""
    for kernel in compiled_kernels():
        if kernel.folder is None:
            raise InputError(
                f"compiled kernels ({kernel.name}) cannot be kept: neither the installation nor "
                "the user's cache folder can be written to; set NUMBA_CACHE_DIR to a folder that "
                "can, now and for each run"
            )


def _warm_up(warmup: Warmup) -> None:
    case = load_case(warmup.case).replace(warmup.settings)
    if warmup.solve == "case":
        run_case(case)
        return
    models = build_any(case)
    if warmup.solve == "hood at rest":
        start, hood = models.start(), models.hood
        motion = models.finger.motion(start.finger)
        hood.advance(start.hood, motion, np.zeros(len(hood.tendons)), 0.0)


def _bake_tetrahedron() -> None:
    """Call the kernels of baking, which bones that were baked before do not."""
    corners = 1e-3 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    SplineDistance.bake(corners, faces)


def _bones_folder() -> str:
    cache = user_cache()
    if cache is None or not cache.folder.is_dir():
        return "nowhere: there is no cache folder of the user, or it is turned off"
    return f"in {shown_path(cache.folder)}"
