"""The same bytes from any number of threads."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator

import numpy as np

from cosim.errors import CosimError
from fe_solver.elements.kernels import PAYS, thread_count
from fe_solver.solver.linear_algebra import VARIABLE, backend_name
from fe_solver.solver.newton import NewtonOptions, solve
from tests.helpers.rows import Row
from tests.proofs.fe import sheets
from tests.proofs.fe.json_command import python, run_json_command, threads
from tests.proofs.fe.peers import strip

MESH = (60, 20)
THREADS = (1, 2)


def digest() -> dict[str, str | int]:
    """Digest of the bytes of an equilibrium and its tangent, on a mesh large enough for threads,
    and the number of threads that made it."""
    model, load = strip(*MESH)
    assert len(model.quads) >= PAYS
    options = NewtonOptions(tolerance=1e-8)
    solution = solve(
        model.with_changes(dead=load), sheets.at_rest(model), sheets.NO_TENSION, options
    )
    c, tangent = solution.configuration, solution.evaluation.data
    assert tangent is not None
    text = b"".join(np.ascontiguousarray(a).tobytes() for a in (c.x, c.d, tangent))
    return {"threads": thread_count(), "sha256": hashlib.sha256(text).hexdigest()}


def rows() -> Iterator[Row]:
    """Yield rows of SuperLU with all threads, its libraries' too, and of the linear solver in use,
    if that is another, with those of the assembly: how a BLAS adds up by its threads is its own
    affair."""
    yield _row("superlu", [threads(n, n) for n in THREADS])
    if backend_name() != "superlu":
        yield _row(backend_name(), [threads(n, 1) for n in THREADS])


def _row(linear: str, settings: list[dict[str, str]]) -> Row:
    """Solved in processes of their own."""
    name, what = "threads 1 and 2", f"different bytes of shape and tangent, {linear}"
    try:
        runs = [run_json_command(python("-m", __name__), {**s, VARIABLE: linear}) for s in settings]
    except CosimError as error:
        return Row(name, what, 0, float("nan"), 0.0, str(error), "absolute")
    assert [one["threads"] for one in runs] == list(THREADS)
    others = len({one["sha256"] for one in runs}) - 1
    source = f"the solve with one thread, {MESH[0]} x {MESH[1]} quads, by SHA-256"
    return Row(name, what, 0, others, 0.0, source, "absolute")


if __name__ == "__main__":
    print(json.dumps(digest()), flush=True)
