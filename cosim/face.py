"""The public face: what `import cosim` offers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.build.models import build
from cosim.case.file import case_of, load_case, packaged_cases
from cosim.case.schema import Case
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium, equilibrium
from cosim.errors import CosimError, InputError, Progress, quiet
from cosim.pipeline import run_case, run_cases
from cosim.port import Finger, Hood, Pair, PairState, Tensions
from cosim.results.compare import as_dict, compare_with_targets, numbers_of, read_targets, unit_of
from cosim.results.quantities import check_quantities
from cosim.results.read import read_run
from cosim.results.result import Result
from cosim.solve.session import Session

if TYPE_CHECKING:
    import pandas


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

    A script that starts processes needs `if __name__ == "__main__":` around what it does.

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
