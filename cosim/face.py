"""The public face: what `import cosim` offers."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.arguments import (
    by_name,
    case_file,
    case_from,
    cases_from,
    fraction,
    is_several,
    pair_from,
    quantity_in_si,
    result_from,
    run_folder,
    session_from,
    whole_number,
)
from cosim.case.file import packaged_cases
from cosim.case.schema import Case
from cosim.coupling.equilibrium import CouplingOptions, equilibrium
from cosim.errors import CosimError, InputError, Progress, quiet, unexpected
from cosim.files import is_path, path_from
from cosim.models.build import build
from cosim.outcome import Outcome
from cosim.pipeline import run_case, run_each
from cosim.port import AXES, Finger, Hood, PairState, Tensions
from cosim.results.compare import as_dict, compare_with_targets, numbers_of, read_targets, unit_of
from cosim.results.coupled import CoupledResult
from cosim.results.quantities import check_quantities
from cosim.results.read import read_run
from cosim.results.result import Result
from cosim.results.sweep import describe_sweep, draw_over, sweep_over
from cosim.schema import units
from cosim.solve.session import Session

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from cosim.analyses.estimate.joint_motion import JointMotion
    from cosim.analyses.identify.fit import Fit
    from cosim.models.build import Models
    from cosim.scoring.names import FingerName
    from cosim.scoring.scores import Scores
    from cosim.study.results import StudyResults
    from cosim.validation.run import Board


AnyCase = str | Path | Mapping[str, Any] | Case | Result
"""A case by the name of a packaged one, the path of a file, a table that says the same, as it was
loaded, or as it was run."""
MOST_WORKERS, MOST_STEPS = 1024, 1000
_NAMES = '{"EDC": "EDCI"}'


def load(case: AnyCase, settings: Sequence[str] = ()) -> Case:
    """A checked case: SI units, angles in rad.

    `case`: the name of a packaged one, the path of a case file, or a table (a mapping) that says
    the same; a `Case`, or a `Result` for the case that it is of.  `settings`: texts KEY=VALUE that
    come on top, with units as in a case file.

    >>> import cosim
    >>> case = cosim.load("pulley_edc", ["tendons.EDC.tension=5 N"])
    >>> case.hood.kind, case.tension("EDC")
    ('pulley', 5.0)

    Raises InputError that lists every fault with its place and what to write instead."""
    return case_from(case, settings)


def run(case: AnyCase, session: Session | None = None, progress: Progress = quiet) -> Result:
    """The result of a case, as `load` takes it: its equilibrium, one-way pass or motion, whichever
    the case asks for.

    `session`: what the runs of several cases share; those that differ only in their tendons use
    the same models and unloaded equilibrium.  `progress` is called with each stage in words.

    >>> import cosim
    >>> result = cosim.run("pulley_edc")
    >>> result.tip_force["dorsal"] > 0  # N
    True

    Raises InputError where case and models do not fit, and ConvergenceError where there is no
    equilibrium."""
    return run_case(case_from(case), session_from(session), progress)


def run_many(
    cases: Iterable[AnyCase],
    workers: int = 1,
    progress: Progress = quiet,
    *,
    keep_errors: bool = False,
) -> list[Result | CosimError]:
    """The results of cases, each as `load` takes it, in their order, run side by side in `workers`
    processes: the same bytes for any number of them.  `progress` is called as each case ends, and
    last, where the cases differ in one number alone, with how rough the results are along it.
    With `keep_errors` a case without a result has the error in its place, else the first such error
    is raised once all have ended.

    >>> import cosim
    >>> case = cosim.load("pulley_edc")
    >>> pulls = [case.replace({"tendons.EDC.tension": f"{n} N"}, name=f"{n} N") for n in (1, 2)]
    >>> weak, strong = cosim.run_many(pulls)
    >>> strong.summary["fingertip_magnitude_N"] > weak.summary["fingertip_magnitude_N"]
    True

    Raises InputError and ConvergenceError."""
    checked, workers = cases_from(cases), whole_number("workers", workers, 1, MOST_WORKERS)

    def tell(done: int, i: int, outcome: Outcome[Result]) -> None:
        words = "" if outcome.error is None else f": {outcome.error}"
        progress(f"{done} of {len(checked)}: {checked[i].name}{words}")

    ended = run_each(checked, _unchanged, workers, tell)
    for outcome in ended if not keep_errors else ():
        outcome.result()
    results = [outcome.error or outcome.result() for outcome in ended]
    if progress is not quiet and (said := describe_sweep(results)):
        progress(said)
    return results


def _unchanged(result: Result) -> Result:
    return result


def plot_over(
    results: Iterable[Result | CosimError],
    parameter: str,
    quantities: Sequence[str] = ("fingertip_force_N.dorsal",),
) -> Figure:
    """A matplotlib figure of quantities of results, as `run_many` gives them, over a parameter by
    its dotted key in the case file; the legend says how rough each is: the rms of what cubics
    leave over all windows of 20 deg, along another unit over all.  A run that failed is a gap.

    >>> import cosim
    >>> case = cosim.load("pulley_edc")
    >>> postures = [case.replace({"finger.posture.PIP": f"{a} deg"}) for a in range(40, 47)]
    >>> figure = cosim.plot_over(cosim.run_many(postures), "finger.posture.PIP")
    >>> figure.axes[0].get_xlabel()
    'finger.posture.PIP, deg'

    Raises InputError for a parameter that is no number of the cases, and for a quantity that no run
    can have."""
    if not is_several(results):
        raise unexpected("results", "a list of results, as run_many gives them", results)
    names = [quantities] if isinstance(quantities, str) else list(quantities)
    return draw_over(sweep_over(list(results), parameter), names)


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
    return read_run(path_from("folder", folder))


def compare(*results: Result | str | Path, data: str | Path | None = None) -> pandas.DataFrame:
    """Results, or the folders of runs, side by side: a row for each number of their summaries, with
    its unit, and a column for each result (those of one name are numbered).

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

    runs = [result_from(result, f"results[{i}]") for i, result in enumerate(results)]
    if not runs:
        raise InputError("compare: expected one or more results")
    if data is not None:
        if len(runs) != 1:
            raise InputError(f"compare: data go beside one result, not {len(runs)}")
        (one,), targets = runs, read_targets(path_from("data", data))
        check_quantities(targets, [(one.case, one.summary)])
        rows = compare_with_targets(targets, one.summary, one.case)
        return pandas.DataFrame([as_dict(row) for row in rows])
    columns: dict[str, dict[str, float]] = {}
    for result in runs:
        alike = [name for name in columns if name.partition(" (")[0] == result.name]
        name = f"{result.name} ({len(alike) + 1})" if alike else result.name
        columns[name] = numbers_of(result.summary)
    table = pandas.DataFrame(columns)
    table.insert(0, "unit", [unit_of(quantity) for quantity in table.index])
    return table


def couple(
    finger: Finger | AnyCase,
    hood: Hood | AnyCase,
    tensions: Mapping[str, float | str],
    posture: Mapping[str, float | str] | None = None,
    *,
    resting: float | str = 0.0,
    tolerance: float = 1e-8,
    max_iterations: int = 50,
    progress: Progress = quiet,
) -> CoupledResult:
    """The equilibrium of a finger and a hood of one's own behind the port, without a case file.

    `finger`: one behind `cosim.port.Finger`, or a case, as `load` takes it, whose finger (and
    posture) is taken.  `hood`: one behind `cosim.port.Hood`, or a case whose hood (and lesion) is
    taken, laid on the finger where that is of a case too.  `tensions`: N, or texts with their unit,
    by tendon; those not named pull with `resting`.  `posture`: rad, or texts, by joint, where the
    finger starts and its tip is held.  `tolerance`: of the interface residual, relative; there are
    at most `max_iterations` steps to it.  `progress` is called with each in words.

    What it returns has a result's `tip_force`, `slips`, `excursions`, `moment_arms`,
    `joint_torques`, `joint_forces` and `audit`.

    >>> import cosim
    >>> solved = cosim.couple("pulley_edc", "pulley_edc", {"EDC": 3.0})
    >>> solved.tip_force["dorsal"] > 0 and solved.audit.passed
    True

    Raises InputError for a tendon that neither has or that would push, and ConvergenceError."""
    pair, held, slips = pair_from(finger, hood)
    pulls = by_name("tensions", tensions, '{"EDC": 3.0}')
    known = (*pair.hood.tendons, *pair.finger.tendons)
    for name in pulls:
        if name not in known:
            raise InputError(
                f"tensions: no tendon {name}; hood and finger have {', '.join(known) or 'none'}"
            )
    force = {t: quantity_in_si(f"tensions.{t}", v, units.FORCE, 0.0) for t, v in pulls.items()}
    rest = quantity_in_si("resting", resting, units.FORCE, 0.0)
    angles = by_name("posture", held if posture is None else posture, '{"PIP": 0.5}')
    start = pair.finger.start(
        {j: quantity_in_si(f"posture.{j}", v, units.ANGLE) for j, v in angles.items()}
    )
    initial = PairState(start, pair.hood.start(pair.finger.motion(start)))
    asked = [
        np.array([force.get(name, rest) for name in tendons], dtype=float)
        for tendons in (pair.hood.tendons, pair.finger.tendons)
    ]
    most = whole_number("max_iterations", max_iterations, 1, 10_000)
    options = CouplingOptions(fraction("tolerance", tolerance), most)
    solved = equilibrium(pair, initial, Tensions(*asked), options, progress)
    forces = None if slips is None else slips(solved)
    return CoupledResult(**vars(solved), pair=pair, slips=dict(forces or {}))


def moment_arms(case: AnyCase, steps: int = 9) -> pandas.DataFrame:
    """Moment arms of all tendons of a case, as `load` takes it, while each joint passes its range
    in so many postures and the others keep the case's.

    Columns joint, angle_deg, tendon, arm_mm; flexion and radial abduction are positive.  A hood's
    arms are those under the case's tensions; a posture that it could not follow is left out.

    >>> import cosim
    >>> table = cosim.moment_arms("split_edc", steps=2)
    >>> bool((table[(table.tendon == "FDP") & (table.joint == "PIP")].arm_mm > 0).all())
    True

    Raises InputError."""
    from cosim.analyses.moment_arms import sweep
    from cosim.fingers.kinds import joint_ranges
    from cosim.models.build import tensions

    checked, steps = case_from(case), whole_number("steps", steps, 1, MOST_STEPS)
    models = build(checked)
    return sweep(models, tensions(checked, models)[0], joint_ranges(models.finger), steps)[0]


def estimate(
    case: AnyCase,
    force: Mapping[str, float | str | None] | None = None,
    torques: Mapping[str, float | str] | None = None,
    progress: Progress = quiet,
) -> pandas.DataFrame:
    """The tensions of least cost (sum of squared stresses) that make a fingertip force or joint
    torques in the posture of a case, as `load` takes it, with the case's hood behind them; a row
    for each muscle.

    `force`: of the fingertip on the world along distal, radial and dorsal, N or a text with its
    unit; None leaves a component open, and one that is not named is zero.  `torques`: N m or a text
    with its unit, by joint; a joint that is not named bears none.  The table's `attrs` hold what
    was asked for and what the case makes when it is run forward under the tensions, by component.

    >>> import cosim
    >>> push = {"distal": -1, "dorsal": -2, "radial": None}
    >>> table = cosim.estimate("split_edc", push)
    >>> bool((table.tension_N >= 0).all())
    True

    Raises InputError, also where no tensions within their bounds make it, and ConvergenceError."""
    from cosim.analyses.estimate.files import muscle_table
    from cosim.analyses.estimate.of_case import for_force, for_torques, setup

    if (force is None) == (torques is None):
        raise InputError("estimate: give a force or torques")
    checked = case_from(case)
    given = by_name("force", force, '{"distal": -1.0}') if torques is None else {}
    strange = sorted(set(given) - set(AXES))
    if strange:
        raise InputError(f"force: no axis {strange[0]!r}; there are {', '.join(AXES)}")
    x, y, z = (_in_si("force", axis, given.get(axis, 0.0), units.FORCE) for axis in AXES)
    if x is None and y is None and z is None:
        raise InputError("force: every component is left open; ask for one at least")
    asked = {} if torques is None else by_name("torques", torques, '{"PIP": 0.05}')
    values = {j: quantity_in_si(f"torques.{j}", v, units.TORQUE) for j, v in asked.items()}
    problem = setup(checked, "pcsa", 2, {}, {})
    answer = (
        for_force(problem, (x, y, z), progress)
        if torques is None
        else for_torques(problem, values, progress)
    )
    table = muscle_table(problem.capacity, answer.estimate.tension)
    names, unit = answer.demand.names, answer.demand.unit
    table.attrs = {
        "unit": unit,
        "asked": dict(zip(names, map(float, answer.target), strict=True)),
        "forward": dict(zip(names, map(float, answer.audit.components), strict=True)),
    }
    return table


def track(
    case: AnyCase,
    motion: str | Path,
    folder: str | Path,
    markers: str | Path | None = None,
    cutoff: float | str | None = None,
    progress: Progress = quiet,
) -> Case:
    """Move a finger forward along a motion by all its muscles; the case that runs under the
    tensions found.

    `motion`: angles over time (.sto, .mot or .csv), or a .trc whose `markers` a .csv places on the
    straight finger; `cutoff`: of a low-pass filter of the angles, Hz or a text with its unit.
    `folder`/<case name> gets what `cosim estimate --motion --forward` writes: the tensions, the
    angles beside the wanted ones, a picture, and the case `<case name>_forward.toml`, which is
    returned.  A finger that does not follow, or would stray under the tensions alone, is a warning.

    Raises InputError, also for a fingertip that is held, and ConvergenceError; what was reached is
    in the folder then."""
    from cosim.analyses.estimate.files import forward_path, write_tracking
    from cosim.analyses.estimate.markers import read_any_motion
    from cosim.analyses.estimate.tracking import setup_to_follow, track

    started = perf_counter()
    highest = None if cutoff is None else quantity_in_si("cutoff", cutoff, units.FREQUENCY)
    marked = None if markers is None else path_from("markers", markers)
    checked, path = case_from(case), path_from("motion", motion)
    target = path_from("folder", folder) / checked.name

    def read(models: Models) -> JointMotion:
        return read_any_motion(path, marked, models.finger, models.posture, None, highest, progress)

    problem, asked = setup_to_follow(checked, "pcsa", 2, {}, {}, read)
    tracking = track(problem, asked, progress)
    write_tracking(target, problem, tracking, perf_counter() - started)
    if tracking.stopped is not None:
        raise tracking.stopped
    for fault in tracking.faults():
        warnings.warn(fault, stacklevel=2)
    return load(forward_path(target))


def _in_si(name: str, axis: str, value: Any, kind: units.Kind) -> float | None:
    """A value that is given in SI units or as text, in SI units.  Raises InputError."""
    return None if value is None else quantity_in_si(f"{name}.{axis}", value, kind)


def identify(
    cases: AnyCase | Iterable[AnyCase],
    targets: str | Path,
    free: str | Path | None = None,
    settings: Sequence[str] = (),
    held_out: str | Path | None = None,
    workers: int = 1,
    most: int = 30,
    progress: Progress = quiet,
    allow_unidentified: bool = False,
    profiles: bool = False,
) -> Fit:
    """Fit parameters of one or several cases, each as `load` takes it, to measured values within
    bounds.

    `targets`, `held_out`: CSV files as `compare` takes them; rows held out do not pull.  `free`: a
    TOML file with a table for each parameter, as `cosim identify --free`; None: the built-in ones
    of the cases' laws.  `most`: evaluations of all cases in the search.  `allow_unidentified`: fit
    though the rows cannot tell every parameter; `profiles`: with their profile likelihoods.

    Raises InputError and ConvergenceError."""
    from cosim.analyses.identify.cases import fit_cases, stated_cases
    from cosim.analyses.identify.fit import fit_all

    workers = whole_number("workers", workers, 1, MOST_WORKERS)
    most = whole_number("most", most, 1, 1_000_000)
    path = None if free is None else path_from("free", free)
    apart = () if held_out is None else read_targets(path_from("held_out", held_out))
    measured = path_from("targets", targets)
    with TemporaryDirectory() as place:
        names = [
            case_file(case, Path(place), f"cases[{i}]")
            for i, case in enumerate(cases if is_several(cases) else [cases])
        ]
        stated = stated_cases(names, tuple(settings), path)
        chosen = fit_cases(stated, path, read_targets(measured), apart)
        return fit_all(
            chosen, workers, most, progress,
            allow_unidentified=allow_unidentified, profiles=profiles,
        )  # fmt: skip


def run_study(
    study: str | Path,
    out: str | Path = "studies",
    workers: int = 1,
    progress: Progress = quiet,
    *,
    case: str | Path | None = None,
    samples: int | None = None,
    over: str | None = None,
) -> StudyResults:
    """Solve a case for many values of its parameters, as a study file or a packaged study says,
    and leave table, answers and page in `out`/NAME; runs that `out`/store holds are not done again.
    `workers`: processes; 1: this one, without the study's limit of time.  `case`: a name or file in
    place of the study's own; `samples`: as many in place of the study's; `over`: a key of the case
    with values, all samples at each of them.  `run_study("input_uncertainty", case="split_edc",
    over="tendons.EDC.tension=2 N, 4 N").bands` are percentiles of that case's first numbers by the
    spread of its inputs.  `progress` hears first how many runs it takes.

    Raises InputError."""
    from cosim.study.bands import cost_of
    from cosim.study.engine import in_this_process, local
    from cosim.study.execute import check_libraries, execute_study
    from cosim.study.files import write_study
    from cosim.study.plan import read_plan
    from cosim.study.store import Store

    check_libraries()
    workers = whole_number("workers", workers, 1, MOST_WORKERS)
    out = path_from("out", out)
    case = None if case is None else path_from("case", case)
    samples = None if samples is None else whole_number("samples", samples, 2, 2**22)
    plan = read_plan(path_from("study", study), case, (), samples, over)
    progress(cost_of(plan))
    store = Store((Path(out) / "store").absolute()).open()
    alone = nullcontext(in_this_process)
    with alone if workers == 1 else local(workers) as solve:
        done = execute_study(
            plan, store, solve, False, lambda c: progress(f"{c.done} of {c.total}")
        )
    return write_study(plan, done, store, Path(out) / plan.name)


def converge(
    case: AnyCase, meshes: int = 3, workers: int = 1, progress: Progress = quiet
) -> pandas.DataFrame:
    """A table of what the first numbers of a case, as `load` takes it, owe to its mesh: a row for
    each with its values on so many `meshes`, the coarsest first, observed order or why there is
    none, limit, the error of the case's own mesh, its grid convergence index and a verdict.

    Raises InputError for a motion and for a hood without such meshes, and ConvergenceError where
    the case has no equilibrium."""
    import pandas

    from cosim.analyses.converge import MOST_MESHES, records, solve_meshes

    count = whole_number("meshes", meshes, 2, MOST_MESHES)
    workers = whole_number("workers", workers, 1, MOST_WORKERS)
    study = solve_meshes(case_from(case), count, workers, progress)
    return pandas.DataFrame(records(study)).set_index("quantity")


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

    only = None if only is None else str(path_from("only", only))
    workers = whole_number("workers", workers, 1, MOST_WORKERS)
    return run_validation(choose_groups(only), path_from("out", out), (), workers, progress)


def score(
    *models: str | Path | Case,
    names: Mapping[str, str] | str | Path | None = None,
    finger: FingerName | None = None,
    tolerance: float | str = "0.1 mm",
    workers: int = 1,
    progress: Progress = quiet,
) -> Scores:
    """Hand models beside what was measured: moment arms, forces of a clamped fingertip, shares of
    the flexion moment, slips and strains.

    `models`: MuJoCo files (.xml), OpenSim files (.osim), case files, names of packaged cases, or
    cases.  `names`: from our names of joints, muscles and the tip to the models', or a TOML file of
    such, where they are not found by their usual names.  `finger`: "index", "middle", "ring" or
    "little", else the first that a model has.  `tolerance`: by how much a muscle's length may be
    off OpenSim's, m or a text.  What it returns has the tables `summary` (a row for each model and
    group of numbers: the skill over no answer and the place among reference models) and `table` (a
    row for each number), `hands` with what reading each model lost and what to doubt, and
    `write(path)` for the page.

    >>> import cosim
    >>> scores = cosim.score("split_edc")
    >>> arms = scores.summary.set_index("group").skill["moment arms"]
    >>> bool(0.9 < arms < 1)
    True

    Raises InputError where none of the models can be judged."""
    from cosim.scoring.names import FINGERS, check_names, read_names
    from cosim.scoring.scores import score_models

    if finger not in (None, *FINGERS):
        raise unexpected("finger", f"one of {', '.join(FINGERS)}, or None", finger)
    for i, model in enumerate(models):
        match model:
            case Case() | str() | Path():
                continue
        raise unexpected(f"models[{i}]", "the path of a model, the name of a case, a Case", model)
    if names is None or is_path(names):
        mapping = {} if names is None else read_names(path_from("names", names))
    else:
        mapping = check_names(by_name("names", names, _NAMES), "names")
    off = quantity_in_si("tolerance", tolerance, units.LENGTH, 0.0)
    workers = whole_number("workers", workers, 1, MOST_WORKERS)
    return score_models(models, {"": mapping}, finger, off, workers, progress)


def write_report(
    *runs: Result | str | Path, out: str | Path = "report.html", data: str | Path | None = None
) -> Path:
    """Write one HTML page of results, or of the runs in folders, beside the values of a CSV file
    where `data` names one; the page's path.

    Raises InputError."""
    from cosim.report import page

    with TemporaryDirectory() as place:
        folders = [
            run_folder(run, Path(place) / str(i), f"runs[{i}]") for i, run in enumerate(runs)
        ]
        measured = None if data is None else path_from("data", data)
        page.write_report(folders, path_from("out", out), "html", data=measured)
    return Path(out)
