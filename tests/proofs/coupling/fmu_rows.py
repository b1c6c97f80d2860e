"""Rows of `cosim verify coupling` about FMUs: written, validated, run, coupled again."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium, equilibrium
from cosim.fmu.finger import FmuFinger, FmuMovingFinger
from cosim.fmu.hood import FmuHood
from cosim.fmu_export.run import PARTS
from cosim.fmu_export.write import write_fmu
from cosim.models.build import Models, build, tensions
from cosim.models.motion import MovingModels, moving_models
from cosim.pipeline import run_case
from cosim.port import STATIC, AffineLoad, Array, Hood, Pair, PairState, Tensions
from cosim.solve.solvers import solve
from tests.helpers.rows import Row

TOLERANCE = 1e-9
"""N, of the fingertip force."""
NATIVE = "the same case without FMUs"
TIGHT = 1e-12
"""rad, to which the fixed point goes on: its force then is to TOLERANCE."""
SLOW = ("hood.mesh.quads=120",)
MOTION_OF_UNITS = (
    "output.picture=false",
    'tendons.EDC.signal={kind="points",at=[["0 s",0.02],["0.05 s",1.0]]}',
    'forward={duration="0.05 s",must_rest=false}',
)
"""The extensor pulls within 50 ms, and"""
MOTION = (
    *MOTION_OF_UNITS,
    'finger.tip={kind="free"}',
    'finger.limit={half_range="40 deg",damping="0.01 N*m*s/deg"}',
)
"""a free finger, with room to move, follows."""


def rows(name: str, settings: Sequence[str]) -> Iterator[Row]:
    """For FMI 2 and 3: validation, 1 s in FMPy, rollback, the fingertip force and the time a step.

    Raises InputError and ConvergenceError."""
    case = load_case(name, settings)
    models = build(case)
    native = solve_coupled(case, models, models.hood)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        for fmi in (2, 3):
            paths = {part: Path(folder) / f"{name}_{part}{fmi}.fmu" for part in PARTS}
            for part, path in paths.items():
                write_fmu(case, part, fmi, path)
                yield from _accepting_row(f"{name}, {part}, FMI {fmi}", path)
            del paths["coupled"]
            yield from _solve_coupled(f"{name}, FMI {fmi}", case, settings, models, native, paths)


def motion_rows() -> Iterator[Row]:
    """For FMI 2 and 3: a finger and a hood in motion in units, by three schemes.

    Raises InputError and ConvergenceError."""
    case = load_case("pulley_edc", MOTION)
    assert case.forward is not None  # stated in MOTION
    models = moving_models(case, case.forward)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        for fmi in (2, 3):
            paths = {part: Path(folder) / f"{part}{fmi}.fmu" for part in PARTS}
            for part, path in paths.items():
                write_fmu(case, part, fmi, path)
                yield from _accepting_row(f"motion, {part}, FMI {fmi}", path)
            del paths["coupled"]
            for scheme in ("explicit", "implicit", "linear"):
                native = run_case(load_case("pulley_edc", [*MOTION, _scheme(scheme)]))
                both = in_units(models, paths, scheme)
                ours = run_case(load_case("pulley_edc", [*MOTION_OF_UNITS, *both]))
                gap = float(np.abs(ours.data.angle - native.data.angle).max())
                what = f"hood and finger in FMUs, {scheme}: angles over 50 steps, rad"
                yield Row(f"motion, FMI {fmi}", what, 0, gap, TOLERANCE, NATIVE, "absolute")
            yield time_row(f"motion, FMI {fmi}", "finger", *_times_of_motion(models, paths))


def solve_coupled(case: Case, models: Models, hood: Hood) -> Equilibrium:
    """The case's equilibrium with `hood` in its hood's place."""
    start = models.finger.start(models.posture)
    options = CouplingOptions(case.solve.tolerance, case.solve.max_iterations)
    initial = PairState(start, hood.start(models.finger.motion(start)))
    pulls = Tensions(*tensions(case, models))
    return equilibrium(Pair(models.finger, hood), initial, pulls, options)


def _accepting_row(name: str, path: Path) -> Iterator[Row]:
    from fmpy import simulate_fmu
    from fmpy.validation import validate_fmu

    problems = validate_fmu(str(path))
    yield Row(name, "problems that FMPy finds", 0, len(problems), 0, "fmpy.validation", "absolute")
    times = simulate_fmu(str(path), stop_time=1.0, output_interval=0.1)["time"]
    yield Row(name, "time reached in FMPy, s", 1, float(times[-1]), 1e-9, "fmpy", "absolute")


def _solve_coupled(
    name: str,
    case: Case,
    settings: Sequence[str],
    models: Models,
    native: Equilibrium,
    paths: dict[str, Path],
) -> Iterator[Row]:
    native_hood = models.hood
    hood = FmuHood(paths["hood"], native_hood.bodies, native_hood.tendons, native_hood.sources)
    force = solve_coupled(case, models, hood).known_balance.tip_force
    yield _force_row(name, "hood in an FMU", force, native)
    hood.tangent_by = "differences"
    force = solve_coupled(case, models, hood).known_balance.tip_force
    yield _force_row(name, "hood in an FMU, its tangent by differences", force, native)
    hood.tangent_by = "outputs"
    for scheme in ("newton", "implicit"):
        both = load_case(case.source, [*settings, *in_units(models, paths, scheme)])
        units, states = solve(both)
        force = units.finger.tip_force(states.loaded.finger_state)
        yield _force_row(name, f"hood and finger in FMUs, {scheme}", force, native)
    yield _rollback(name, hood, native)
    yield time_row(name, "hood", *[_time_of_answer(h, native) for h in (native_hood, hood)])
    yield time_row(name, "finger", *_times_of_rest(case, models, paths["finger"], native))


def in_units(models: Models | MovingModels, paths: Mapping[str, Path], scheme: str) -> list[str]:
    """Settings that put units (by part, hood and finger or one of them) in a case's models' places,
    met by a scheme."""
    f, h = models.finger, models.hood
    parts = {
        "finger": {"bodies": f.bodies, "joints": f.joints, "tendons": f.tendons},
        "hood": {"tendons": h.tendons, "sources": h.sources},
    }
    out = [_scheme(scheme)]
    for part, path in paths.items():
        facts = {"kind": "fmu", "path": str(path), **parts[part]}
        table = ",".join(f"{key}={json.dumps(value)}" for key, value in facts.items())
        out.append(f"{part}={{{table}}}")
    return out


def _scheme(name: str) -> str:
    return f'coupling={{scheme="{name}",tolerance="{TIGHT} rad"}}'


def _force_row(name: str, what: str, force: Array, native: Equilibrium) -> Row:
    gap = float(np.abs(force - native.known_balance.tip_force).max())
    return Row(name, f"{what}: fingertip force, N", 0, gap, TOLERANCE, NATIVE, "absolute")


def _rollback(name: str, hood: FmuHood, at: Equilibrium) -> Row:
    """A step repeated from an old state, after another one from there."""
    start = hood.start(at.motion)
    first = hood.advance(start, at.motion, at.hood_tension, STATIC)
    hood.advance(first.state, at.motion, 1.1 * at.hood_tension, STATIC)
    again = hood.advance(start, at.motion, at.hood_tension, STATIC)
    gap = float(np.abs(first.load.wrench - again.load.wrench).max())
    return Row(name, "a step taken back and repeated, N", 0, gap, 0, "identity", "absolute")


def time_row(name: str, part: str, native: float, unit: float) -> Row:
    """The time (s) of a step that repeats the last one, without its tangent, beside ours; both
    warm.  It is shown: a clock says how busy the machine is."""
    return Row(name, f"{part}: do_step, us", 1e6 * native, 1e6 * unit, 0, NATIVE, "shown")


def _time_of_answer(hood: Hood, at: Equilibrium) -> float:
    """The time (s) of a hood's static step."""
    if hasattr(hood, "tangent_by"):  # a unit's
        hood.tangent_by = "differences"
    first = hood.advance(hood.start(at.motion), at.motion, at.hood_tension, STATIC)
    return _median(lambda: hood.advance(first.state, at.motion, at.hood_tension, STATIC))


def _times_of_rest(case: Case, models: Models, path: Path, at: Equilibrium) -> tuple[float, float]:
    """The times (s) of a finger's equilibrium under the hood's load, from there: native, and in a
    unit."""
    f, load, pulls = models.finger, at.load, at.finger_tension
    slope, tolerance = at.jacobian.load_motion, case.solve.tolerance
    unit = FmuFinger(path, f.bodies, f.joints, f.tendons)
    settled, _ = unit.settle(unit.start({}), load, slope, pulls, tolerance)
    return (
        _median(lambda: f.settle(at.finger_state, load, slope, pulls, tolerance)),
        _median(lambda: unit.settle(settled, load, slope, pulls, tolerance)),
    )


def _times_of_motion(models: MovingModels, paths: Mapping[str, Path]) -> tuple[float, float]:
    """The times (s) of a finger's step under a held load: native, and in a unit."""
    native, f = models.finger, models.finger
    unit = FmuMovingFinger(paths["finger"], f.bodies, f.joints, f.tendons)
    start, pulls = native.begin(models.posture), np.ones(len(f.tendons))
    n = 6 * len(f.bodies)
    load = AffineLoad(native.motion(native.angles(start)), np.zeros((n // 6, 6)), np.zeros((n, n)))
    return (
        _median(lambda: native.step(start, load, pulls, models.moves.dt)),
        _median(lambda: unit.step(unit.begin({}), load, pulls, models.moves.dt)),
    )


def _median(call: Callable[[], object]) -> float:
    """The median time (s) of 21 calls."""
    spent = []
    for _ in range(21):
        started = time.perf_counter()
        call()
        spent.append(time.perf_counter() - started)
    return float(np.median(spent))
