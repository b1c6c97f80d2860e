"""The public face: what `import cosim` offers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.build.models import build
from cosim.case.file import case_of, load_case, packaged_cases
from cosim.case.schema import Case
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium, equilibrium
from cosim.errors import CosimError, InputError, Progress, quiet
from cosim.pipeline import run_case, run_cases
from cosim.port import AXES, Finger, Hood, Pair, PairState, Tensions
from cosim.results.compare import as_dict, compare_with_targets, numbers_of, read_targets, unit_of
from cosim.results.quantities import check_quantities
from cosim.results.read import read_run
from cosim.results.result import Result
from cosim.schema import units
from cosim.solve.session import Session

if TYPE_CHECKING:
    import pandas

    from cosim.analyses.identify.fit import Fit
    from cosim.study.results import StudyResults
    from cosim.validation.run import Board


def load(case: str | Path | Mapping[str, Any], settings: Sequence[str] = ()) -> Case:
    """A checked case: SI units, angles in rad.

    `case`: the name of a packaged one, the path of a case file, or a table (a mapping) that says
    the same.  `settings`: texts KEY=VALUE that come on top, with units as in a case file.

    >>> import cosim
    >>> case = cosim.load("pulley_edc", ["tendons.EDC.tension=5 N"])
    >>> case.hood.kind, case.tension("EDC")
    ('pulley', 5.0)

    Raises InputError that lists every fault with its place and what to write instead."""
    match case:
        case Mapping():
            return case_of(case)
        case _:
            return load_case(case, settings)


def run(case: Case, session: Session | None = None, progress: Progress = quiet) -> Result:
    """The result of a case: its equilibrium, one-way pass or motion, whichever the case asks for.

    `session`: what the runs of several cases share; those that differ only in their tendons use
    the same models and unloaded equilibrium.  `progress` is called with each stage in words.

    >>> import cosim
    >>> result = cosim.run(cosim.load("pulley_edc"))
    >>> result.tip_force["dorsal"] > 0  # N
    True

    Raises InputError where case and models do not fit, and ConvergenceError where there is no
    equilibrium."""
    return run_case(case, session, progress)


def run_many(
    cases: Sequence[Case],
    workers: int = 1,
    progress: Progress = quiet,
    *,
    keep_errors: bool = False,
) -> list[Result | CosimError]:
    """The results of cases, in their order, run side by side in `workers` processes: the same bytes
    for any number of them.  `progress` is told of each case that ends.  With `keep_errors` a case
    without a result has the error in its place, else the first such error is raised once all have
    ended.

    >>> import cosim
    >>> case = cosim.load("pulley_edc")
    >>> pulls = [case.replace({"tendons.EDC.tension": f"{n} N"}, name=f"{n} N") for n in (1, 2)]
    >>> weak, strong = cosim.run_many(pulls)
    >>> strong.summary["fingertip_magnitude_N"] > weak.summary["fingertip_magnitude_N"]
    True

    Raises InputError and ConvergenceError."""
    results: dict[int, Result] = {}
    errors: dict[int, CosimError] = {}
    for i, result, error in run_cases(cases, _as_it_is, workers):
        if result is not None:
            results[i] = result
        if error is not None:
            errors[i] = error
        done, words = len(results) + len(errors), "" if error is None else f": {error}"
        progress(f"{done} of {len(cases)}: {cases[i].name}{words}")
    if errors and not keep_errors:
        raise errors[min(errors)]
    return [results.get(i) or errors[i] for i in range(len(cases))]


def _as_it_is(result: Result) -> Result:
    return result


def list_cases() -> list[str]:
    """The names of the packaged cases, which `load` takes.

    >>> import cosim
    >>> "isometric_edc" in cosim.list_cases()
    True
    """
    return sorted(packaged_cases())


def open_run(folder: str | Path) -> Result:
    """The result that `Result.save` or the command `cosim run` left in a folder.

    >>> import tempfile
    >>> import cosim
    >>> result = cosim.run(cosim.load("pulley_edc").replace({"output.picture": False}))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     again = cosim.open_run(result.save(folder))
    >>> again.tip_force == result.tip_force
    True

    Raises InputError for a folder without a run, or with one of another format."""
    return read_run(Path(folder))


def compare(*results: Result, data: str | Path | None = None) -> pandas.DataFrame:
    """Results side by side: a row for each number of their summaries, with its unit, and a column
    for each result (those of one name are numbered).

    With `data`, a CSV file of measured or published values, one result beside these: a row for
    each value with its verdict.

    >>> import cosim
    >>> one = cosim.load("pulley_edc")
    >>> more = one.replace({"tendons.EDC.tension": "5 N"}, name="5 N")
    >>> table = cosim.compare(cosim.run(one), cosim.run(more))
    >>> list(table.columns)
    ['unit', 'pulley_edc', '5 N']

    Raises InputError for data beside other than one result, and for a file that cannot be read."""
    import pandas

    if data is not None:
        if len(results) != 1:
            raise InputError(f"compare: data go beside one result, not {len(results)}")
        (one,), targets = results, read_targets(Path(data))
        check_quantities(targets, [(one.case, one.summary)])
        rows = compare_with_targets(targets, one.summary, one.case)
        return pandas.DataFrame([as_dict(row) for row in rows])
    columns: dict[str, dict[str, float]] = {}
    for result in results:
        alike = [name for name in columns if name.partition(" (")[0] == result.name]
        name = f"{result.name} ({len(alike) + 1})" if alike else result.name
        columns[name] = numbers_of(result.summary)
    table = pandas.DataFrame(columns)
    table.insert(0, "unit", [unit_of(quantity) for quantity in table.index])
    return table


def couple(
    finger: Finger | Case,
    hood: Hood,
    tensions: Mapping[str, float],
    posture: Mapping[str, float] | None = None,
    *,
    resting: float = 0.0,
    tolerance: float = 5e-7,
    max_iterations: int = 50,
    progress: Progress = quiet,
) -> Equilibrium:
    """The equilibrium of a finger and a hood of one's own behind the port, without a case file.

    `finger`: one behind `cosim.port.Finger`, or a case whose finger (and posture) is taken.
    `tensions`: N by tendon; those not named pull with `resting` (N).  `posture`: rad by joint,
    where the finger starts and its tip is held.  `tolerance`: of the interface residual, relative;
    there are at most `max_iterations` steps to it.  `progress` is called with each in words.

    >>> import cosim
    >>> from cosim.build.models import build
    >>> case = cosim.load("pulley_edc")
    >>> solved = cosim.couple(case, build(case).hood, {"EDC": 3.0})
    >>> solved.interface_residual < 5e-7
    True

    Raises InputError for a tendon that neither has, and ConvergenceError."""
    if isinstance(finger, Case):
        models = build(finger)
        finger, posture = models.finger, models.posture if posture is None else posture
    unknown = sorted(set(tensions) - {*hood.tendons, *finger.tendons})
    if unknown:
        known = ", ".join((*hood.tendons, *finger.tendons)) or "none"
        raise InputError(f"tensions: no tendon {unknown[0]}; hood and finger have {known}")
    start = finger.start(posture or {})
    pulls = [
        np.array([tensions.get(name, resting) for name in tendons], dtype=float)
        for tendons in (hood.tendons, finger.tendons)
    ]
    initial = PairState(start, hood.start(finger.motion(start)))
    options = CouplingOptions(tolerance, max_iterations)
    return equilibrium(Pair(finger, hood), initial, Tensions(*pulls), options, progress)


def moment_arms(case: Case, steps: int = 9) -> pandas.DataFrame:
    """Moment arms of all tendons while each joint passes its range in so many postures and the
    others keep the case's.

    Columns joint, angle_deg, tendon, arm_mm; flexion and radial abduction are positive.  A hood's
    arms are those under the case's tensions; a posture that it could not follow is left out.

    >>> import cosim
    >>> table = cosim.moment_arms(cosim.load("split_edc"), steps=2)
    >>> bool((table[(table.tendon == "FDP") & (table.joint == "PIP")].arm_mm > 0).all())
    True

    Raises InputError."""
    from cosim.analyses.moment_arms import sweep
    from cosim.build.models import tensions
    from cosim.fingers.kinds import joint_ranges

    models = build(case)
    return sweep(models, tensions(case, models)[0], joint_ranges(models.finger), steps)[0]


def estimate(
    case: Case,
    force: Mapping[str, float | str | None] | None = None,
    torques: Mapping[str, float | str] | None = None,
    progress: Progress = quiet,
) -> pandas.DataFrame:
    """The tensions of least cost (sum of squared stresses) that make a fingertip force or joint
    torques in the case's posture, with the hood of the case behind them; a row for each muscle.

    `force`: of the fingertip on the world along distal, radial and dorsal, N or a text with its
    unit; None leaves a component open, and one that is not named is zero.  `torques`: N m or a text
    with its unit, by joint; a joint that is not named bears none.  The table's `attrs` hold what
    was asked for and what the case makes when it is run forward under the tensions, by component.

    >>> import cosim
    >>> push = {"distal": -1, "dorsal": -2, "radial": None}
    >>> table = cosim.estimate(cosim.load("split_edc"), push)
    >>> bool((table.tension_N >= 0).all())
    True

    Raises InputError, also where no tensions within their bounds make it, and ConvergenceError."""
    from cosim.analyses.estimate.files import muscle_table
    from cosim.analyses.estimate.of_case import for_force, for_torques, setup

    if (force is None) == (torques is None):
        raise InputError("estimate: give a force or torques")
    made = setup(case, "pcsa", 2, {}, {})
    if force is not None:
        strange = sorted(set(force) - set(AXES))
        if strange:
            raise InputError(f"force: no axis {strange[0]!r}; there are {', '.join(AXES)}")
        x, y, z = (_in_si("force", force.get(axis, 0.0), units.FORCE) for axis in AXES)
        answer = for_force(made, (x, y, z), progress)
    else:
        values = {j: _in_si("torques", v, units.TORQUE) or 0.0 for j, v in (torques or {}).items()}
        answer = for_torques(made, values, progress)
    table = muscle_table(made.capacity, answer.estimate.tension)
    names, unit = answer.demand.names, answer.demand.unit
    table.attrs = {
        "unit": unit,
        "asked": dict(zip(names, map(float, answer.target), strict=True)),
        "forward": dict(zip(names, map(float, answer.audit.components), strict=True)),
    }
    return table


def _in_si(name: str, value: float | str | None, kind: units.Kind) -> float | None:
    """Raises InputError."""
    if not isinstance(value, str):
        return None if value is None else float(value)
    try:
        return units.parse(value, kind)
    except ValueError as error:
        raise InputError(f"{name}: {value!r}: {error}") from error


def identify(
    cases: str | Path | Sequence[str | Path],
    targets: str | Path,
    free: str | Path | None = None,
    settings: Sequence[str] = (),
    held_out: str | Path | None = None,
    workers: int = 1,
    most: int = 30,
    progress: Progress = quiet,
) -> Fit:
    """Fit parameters of one or several cases (files or names) to measured values within bounds.

    `targets`, `held_out`: CSV files as `compare` takes them; rows held out do not pull.  `free`: a
    TOML file with a table for each parameter, as `cosim identify --free`; None: the built-in ones
    of the cases' laws.  `most`: evaluations of all cases in the search.

    Raises InputError and ConvergenceError."""
    from cosim.analyses.identify.cases import fit_cases, stated_cases
    from cosim.analyses.identify.fit import fit_all

    names = [cases] if isinstance(cases, str | Path) else list(cases)
    path = None if free is None else Path(free)
    apart = () if held_out is None else read_targets(Path(held_out))
    stated = stated_cases(names, tuple(settings), path)
    chosen = fit_cases(stated, path, read_targets(Path(targets)), apart)
    return fit_all(chosen, workers, most, progress)


def run_study(
    study: str | Path,
    out: str | Path = "studies",
    workers: int = 1,
    progress: Progress = quiet,
) -> StudyResults:
    """Solve a case for many values of its parameters, as a study file or a packaged study says,
    and leave table, answers and page in `out`/NAME; runs that `out`/store holds are not done again.
    `workers`: processes; 1: this one, without the study's limit of time.

    Raises InputError."""
    from cosim.study.engine import in_this_process, local
    from cosim.study.execute import execute_study
    from cosim.study.files import write_study
    from cosim.study.plan import read_plan
    from cosim.study.store import Store

    plan = read_plan(study)
    store = Store((Path(out) / "store").absolute()).open()
    alone = nullcontext(in_this_process)
    with alone if workers == 1 else local(workers) as solve:
        done = execute_study(
            plan, store, solve, False, lambda c: progress(f"{c.done} of {c.total}")
        )
    return write_study(plan, done, store, Path(out) / plan.name)


def validate(
    only: str | None = None,
    out: str | Path = "runs/validation",
    workers: int = 1,
    progress: Progress = quiet,
) -> list[Board]:
    """The model beside everything that was measured or published, or the trials whose name holds
    `only`: a board for each group, with its rows and its skill over null models.  Runs of the
    trials are left in `out`.

    Raises InputError."""
    from cosim.validation.run import choose_groups, run_validation

    return run_validation(choose_groups(only), Path(out), (), workers, progress)


def write_report(
    *runs: str | Path, out: str | Path = "report.html", data: str | Path | None = None
) -> Path:
    """Write one HTML page of the runs in these folders, beside the values of a CSV file where
    `data` names one; the page's path.

    Raises InputError."""
    from cosim.report import write

    write.write_report(
        [Path(run) for run in runs], Path(out), "html", data=None if data is None else Path(data)
    )
    return Path(out)
