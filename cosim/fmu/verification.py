"""Rows of `cosim verify coupling` about FMUs: written, validated, run, coupled again."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from cosim.build import Models, build, tensions
from cosim.case import load_case
from cosim.case_schema import Case
from cosim.couple import CouplingOptions, Equilibrium, equilibrium
from cosim.fmu.export import write_fmu
from cosim.fmu.finger import FmuFinger, met
from cosim.fmu.participant import FmuHood
from cosim.fmu.parts import PARTS
from cosim.port import STATIC, Array, Hood
from cosim.verification import Row, Study

TOLERANCE = 1e-9
"""N, of the fingertip force."""
NATIVE = "the same case without FMUs"
MOST_OVERHEAD = 5e3
"""us a step: what a border of some hundred values may cost at most; no target, a guard."""
SLOW = ("hood.mesh.quads=120",)


def studies() -> tuple[Study, ...]:
    """None where the extra `fmu` is not installed."""
    if any(find_spec(name) is None for name in ("fmpy", "pythonfmu", "pythonfmu3")):
        return ()
    return (
        Study("FMU, cables", lambda: rows("pulley_edc", ())),
        Study("FMU, shell", lambda: rows("isometric_edc", SLOW), slow=True),
    )


def rows(name: str, settings: Sequence[str]) -> Iterator[Row]:
    """For FMI 2 and 3: validation, 1 s in FMPy, rollback, the fingertip force and the time a step.

    Raises InputError and ConvergenceError."""
    case = load_case(name, settings)
    models = build(case)
    native = coupled_by_us(case, models, models.hood)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        for fmi in (2, 3):
            paths = {part: Path(folder) / f"{name}_{part}{fmi}.fmu" for part in PARTS}
            for part, path in paths.items():
                write_fmu(case, part, fmi, path)
                yield from _accepted(f"{name}, {part}, FMI {fmi}", path)
            yield from _coupled(f"{name}, FMI {fmi}", case, models, native, paths)


def coupled_by_us(case: Case, models: Models, hood: Hood) -> Equilibrium:
    """The case's equilibrium with `hood` in its hood's place."""
    pulls, start = tensions(case, models), models.finger.start(models.posture)
    options = CouplingOptions(case.solve.tolerance, case.solve.max_iterations)
    before = hood.start(models.finger.motion(start))
    return equilibrium(models.finger, hood, start, before, *pulls, options)


def _accepted(name: str, path: Path) -> Iterator[Row]:
    from fmpy import simulate_fmu
    from fmpy.validation import validate_fmu

    problems = validate_fmu(str(path))
    yield Row(name, "problems that FMPy finds", 0, len(problems), 0, "fmpy.validation", "absolute")
    times = simulate_fmu(str(path), stop_time=1.0, output_interval=0.1)["time"]
    yield Row(name, "time reached in FMPy, s", 1, float(times[-1]), 1e-9, "fmpy", "absolute")


def _coupled(
    name: str, case: Case, models: Models, native: Equilibrium, paths: dict[str, Path]
) -> Iterator[Row]:
    own = models.hood
    hood = FmuHood(paths["hood"], own.bodies, own.tendons, own.sources)
    force = coupled_by_us(case, models, hood).balance.tip_force
    yield _force_row(name, "hood in an FMU", force, native)
    hood.tangent_by = "differences"
    force = coupled_by_us(case, models, hood).balance.tip_force
    yield _force_row(name, "hood in an FMU, its tangent by differences", force, native)
    hood.tangent_by = "outputs"
    f = models.finger
    finger = FmuFinger(paths["finger"], f.bodies, f.joints, f.tendons)
    both = met(finger, hood, *tensions(case, models)).finger.tip_force
    yield _force_row(name, "hood and finger in FMUs", both, native)
    yield _rollback(name, hood, native)
    yield _overhead(name, own, hood, native)


def _force_row(name: str, what: str, force: Array, native: Equilibrium) -> Row:
    gap = float(np.abs(force - native.balance.tip_force).max())
    return Row(name, f"{what}: fingertip force, N", 0, gap, TOLERANCE, NATIVE, "absolute")


def _rollback(name: str, hood: FmuHood, at: Equilibrium) -> Row:
    """A step repeated from an old state, after another one from there."""
    start = hood.start(at.motion)
    first = hood.advance(start, at.motion, at.hood_tension, STATIC)
    hood.advance(first.state, at.motion, 1.1 * at.hood_tension, STATIC)
    again = hood.advance(start, at.motion, at.hood_tension, STATIC)
    gap = float(np.abs(first.load.wrench - again.load.wrench).max())
    return Row(name, "a step taken back and repeated, N", 0, gap, 0, "identity", "absolute")


def _overhead(name: str, native: Hood, hood: FmuHood, at: Equilibrium) -> Row:
    """Of a step that repeats the last one, without its tangent; both warm."""
    hood.tangent_by = "differences"
    spent = [_time_of_step(h, at) for h in (native, hood)]
    over = 1e6 * (spent[1] - spent[0])
    what = f"do_step over the native {1e6 * spent[0]:.0f} us, us a step"
    return Row(name, what, MOST_OVERHEAD, over, 0, "guard", "bound")


def _time_of_step(hood: Hood, at: Equilibrium) -> float:
    """s, median."""
    first = hood.advance(hood.start(at.motion), at.motion, at.hood_tension, STATIC)
    spent = []
    for _ in range(21):
        started = time.perf_counter()
        hood.advance(first.state, at.motion, at.hood_tension, STATIC)
        spent.append(time.perf_counter() - started)
    return float(np.median(spent))
