"""The main path: case -> models -> coupled equilibria -> result.  Read this file first."""

from __future__ import annotations

import time
from pathlib import Path

from cosim.build.fit import check_fit
from cosim.case.schema import Case
from cosim.port import Progress, quiet
from cosim.processes import one_blas_thread
from cosim.results.data import Result
from cosim.solve.static import solve


@one_blas_thread()
def run_case(case: Case, progress: Progress = quiet, unfinished: Path | None = None) -> Result:
    """Build, solve and summarise a case; a coupled motion keeps its checkpoints in the folder
    `unfinished` and goes on from one that is there.  Raises InputError and ConvergenceError."""
    from cosim.results.static import result

    started = time.perf_counter()
    check_fit(case)
    if case.forward is not None:
        from cosim.results.forward import forward_result
        from cosim.solve.forward import simulated

        if case.hood.kind != "split":
            from cosim.results.motion import motion_result
            from cosim.solve.motion import moved_together

            both, kept = moved_together(case, case.forward, progress, unfinished)
            wall = time.perf_counter() - started
            return motion_result(case, both, kept.frames, kept.tips, kept.moment, wall)
        progress(f"simulating {case.forward.duration:g} s")
        moved = simulated(case, case.forward)
        return forward_result(case, moved, time.perf_counter() - started)
    if case.finger.kind == "fmu":
        from cosim.results.fmu import settled_result

        return settled_result(case, progress)
    models, states = solve(case, progress)
    progress("summing up")
    return result(case, models, states, time.perf_counter() - started)
