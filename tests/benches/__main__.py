"""`python -m tests.benches`: one table of benches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from cosim.case.file import load_case
from cosim.commands.options import Settings
from cosim.commands.terminal import exit_on_error, stages
from cosim.errors import InputError, nearest_names
from cosim.files import check_file, shown_path
from cosim.study.execute import check_libraries
from tests.benches.case import bench_case
from tests.benches.febio import bench_febio
from tests.benches.files import (
    BenchRecord,
    Ratios,
    describe_machine,
    print_side_by_side,
    read_record,
    source_version,
    time_stamp,
    write_record,
)
from tests.benches.finger_speed import (
    bench_fingers,
    bench_mjcf,
    bench_opensim,
    bench_robotic_finger,
)
from tests.benches.growth_table import bench_growth
from tests.benches.history import (
    append_record,
    read_history,
    regressions,
    write_history_page,
)
from tests.benches.loop import bench_loop
from tests.benches.pairs import ROOT, measure_pair, source_folder
from tests.benches.pulls_table import bench_pulls
from tests.benches.shell_speed import bench_fe, bench_solvers
from tests.benches.study import bench_loads, bench_studies

MOST, MOST_OF_ALL = 2400, 1350
"""Largest mesh of `growth`, alone and among all benches, in quads."""
RUNS_OF_ALL = 16
"""Runs of a study among all benches."""
CASE_OF_ALL = "isometric_edc"
MOTION = "motion_edc_fdp"
FIRST_STEPS = ['forward.duration="30 ms"']


@dataclass(frozen=True)
class Options:
    """The options of the command that only some benches read."""

    settings: Settings = None
    models: Path | None = None
    spacing: str = "0.25 mm"
    most: int = MOST


class Bench(NamedTuple):
    """A bench: what it measures, in a line, and the function that measures it, prints it and
    returns its ratios by name."""

    line: str
    measure: Callable[[Options], Ratios]


BENCHES = {
    "fe": Bench("the shell solver's iteration against its floor", lambda o: bench_fe()),
    "febio": Bench(
        "published models beside FEBio (--models, --spacing)",
        lambda o: bench_febio(o.models, o.spacing),
    ),
    "fingers": Bench("the static solve of the finger alone", lambda o: bench_fingers()),
    "growth": Bench(
        "iterations, time and memory on ever finer meshes (--most)", lambda o: bench_growth(o.most)
    ),
    "loads": Bench(
        "500 combined loads of one hood, the same bytes by one and by two workers; half an hour",
        lambda o: bench_loads(),
    ),
    "loop": Bench(
        "a step of a loop of one's own (cosim.Loop) against the finger alone, hood by hood",
        lambda o: bench_loop(),
    ),
    "mjcf": Bench("a step of plain MuJoCo with a hood beside one without", lambda o: bench_mjcf()),
    "motion": Bench(
        "a coupled step of a motion against one assembly and factorisation",
        lambda o: bench_one_case(MOTION, FIRST_STEPS),
    ),
    "opensim": Bench("the finger's motion beside OpenSim's", lambda o: bench_opensim()),
    "pulls": Bench("linear solves of the pulls of tendons, beside before", lambda o: bench_pulls()),
    "robot": Bench(
        "the robotic finger's control loop beside its paper's", lambda o: bench_robotic_finger()
    ),
    "solvers": Bench("the linear solvers on one tangent of a hood", lambda o: bench_solvers()),
    "studies": Bench("handing out runs, and two workers beside one", lambda o: bench_studies()),
}
OF_ALL: dict[str, Callable[[], Ratios]] = {
    "fe": bench_fe,
    "fingers": bench_fingers,
    "mjcf": bench_mjcf,
    "pulls": bench_pulls,
    "growth": lambda: bench_growth(MOST_OF_ALL),
    "loop": bench_loop,
    "motion": lambda: bench_one_case(MOTION, FIRST_STEPS),
    CASE_OF_ALL: lambda: bench_one_case(CASE_OF_ALL, None),
    "studies": lambda: bench_studies(RUNS_OF_ALL),
}
"""The benches that need no files or programs from outside, of a size to take minutes."""
ALL, FILES, PAGE = "all", "files", "page"
HISTORY = ROOT / "tests" / "benches" / "bench.csv"
"""The figures that a checkout keeps."""
LINES = {name: bench.line for name, bench in BENCHES.items()} | {
    ALL: f"{', '.join(OF_ALL)}, one after the other (--json, --against)",
    FILES: "the ratios of files that --json wrote, side by side (--against each)",
    PAGE: "the figures that --keep added, over commits, with regressions (--out)",
}


def bench(
    name: Annotated[
        str,
        typer.Argument(
            metavar="CASE|NAME",
            help="Case file or packaged case: a coupled run against one assembly and one "
            "factorisation of its own tangent. Or a name: "
            + "; ".join(f"{name}: {line}" for name, line in sorted(LINES.items()))
            + ".",
        ),
    ],
    settings: Settings = None,
    models: Annotated[
        Path | None, typer.Option(help="Of febio: folder of the models with published figures.")
    ] = None,
    spacing: Annotated[
        str, typer.Option(help="Of febio: spacing of the grids of the bones' distances.")
    ] = "0.25 mm",
    most: Annotated[
        int, typer.Option(min=250, help="Of growth: largest mesh, in linear quads; up to 16000.")
    ] = MOST,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the ratios to this file.")
    ] = None,
    against: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE|FOLDER|COMMIT",
            help="Show the ratios beside those of this file; repeatable. Or measure in turn with "
            "the version in this folder, or of this commit.",
        ),
    ] = None,
    repeats: Annotated[
        int, typer.Option(min=1, max=100, help="Of a folder or commit: how often each is measured.")
    ] = 2,
    keep: Annotated[
        bool, typer.Option("--keep", help="Add the ratios to cases/bench.csv of the checkout.")
    ] = False,
    out: Annotated[Path, typer.Option("--out", "-o", help="Of page: the file to write.")] = Path(
        "bench.html"
    ),
) -> None:
    """Measure speed, as ratios and counts that depend little on the machine."""
    with exit_on_error():
        if name == PAGE:
            _write_page(out)
            return
        files = [Path(word) for word in against or () if name == FILES or Path(word).is_file()]
        versions = [word for word in against or () if Path(word) not in files]
        if json_file is not None:
            check_file(json_file)
        if name == FILES and not files:
            raise InputError("bench files: name each file with --against")
        if keep and not (ROOT / ".git").exists():
            raise InputError("--keep: needs a checkout of the sources, not an installation")
        if len(versions) > 1:
            raise InputError("--against: one folder or commit at a time")
        records = [read_record(path) for path in files]
        if name != FILES:
            options = Options(settings, models, spacing, most)
            measured = (
                _measure_in_turn(name, options, versions[0], repeats)
                if versions
                else [_record(name, options)]
            )
            records += measured
            if json_file is not None:
                write_record(json_file, measured[-1])
            if keep:
                append_record(HISTORY, measured[-1])
        if against:
            print_side_by_side(records)


def _write_page(out: Path) -> None:
    histories = read_history(HISTORY)
    write_history_page(histories, out)
    for line in regressions(histories):
        typer.echo(f"worse: {line}")
    typer.echo(f"page in {shown_path(out)}")


def _record(name: str, options: Options) -> BenchRecord:
    ratios = _measure(name, options)
    return BenchRecord(source_version(), time_stamp(), describe_machine(), ratios)


def _measure_in_turn(name: str, options: Options, other: str, repeats: int) -> list[BenchRecord]:
    """The records of another version and of this one."""
    place = str(Path(name).absolute()) if Path(name).is_file() else name
    words = [place, "--spacing", options.spacing, "--most", str(options.most)]
    words += [word for setting in options.settings or () for word in ("--set", setting)]
    words += ["--models", str(options.models.absolute())] if options.models else []
    with source_folder(other) as root, stages("bench") as shown:
        return list(measure_pair(words, root, other, repeats, shown.say))


def _measure(name: str, options: Options) -> dict[str, Ratios]:
    """The ratios of a bench, of all, or of a case, by the bench's name."""
    if name in BENCHES:
        return {name: BENCHES[name].measure(options)}
    if name != ALL:
        return {name: bench_one_case(name, options.settings)}
    check_libraries()
    ratios = {}
    for one, measure in OF_ALL.items():
        typer.echo(f"\n{one}")
        ratios[one] = measure()
    return ratios


def bench_one_case(name: str, settings: Settings) -> Ratios:
    """Print what a coupled run of a case costs; raises CosimError."""
    try:
        case = load_case(name, settings or ())
    except InputError as error:
        near = nearest_names(name, LINES)
        raise InputError(f"{error}; or the bench {near[0]}?") if near else error from None

    with stages(case.name) as shown:
        figures = bench_case(case, shown.say)
    for figure, value in figures.items():
        typer.echo(f"{figure:<20} {value:.4g}")
    return {key: value for key, value in figures.items() if key.endswith("ratio")}


if __name__ == "__main__":
    typer.run(bench)
