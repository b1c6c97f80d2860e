"""The command line.  Exit codes: 0 done, 1 a solve did not converge, 2 the input is at fault, 3 a
run missed its audit, 130 the user stopped it."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from cosim import __version__
from cosim.commands.estimate import estimate
from cosim.commands.febio import bench_fe, bench_febio, export, solve
from cosim.commands.finger import bench_fingers, bench_robotic_finger, mjcf, moment_arms
from cosim.commands.fmu import fmu
from cosim.commands.hood import show_hood
from cosim.commands.identify import identify, sensitivity
from cosim.commands.ladder import ladder
from cosim.commands.lesion import lesion
from cosim.commands.new import new
from cosim.commands.opensim import import_model, opensim, sto
from cosim.commands.reduce import reduce
from cosim.commands.report import report
from cosim.commands.reproduce import reproduce
from cosim.commands.study import bench_studies, status, study
from cosim.commands.terminal import console, tell, told, warn, warn_of_audits
from cosim.commands.validate import validate
from cosim.commands.verify import info, verify
from cosim.port import ConvergenceError, CosimError, InputError, StoppedError
from cosim.processes import prepare_process
from cosim.results.audit import describe_misses

if TYPE_CHECKING:
    from cosim.case.schema import Case

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Co-simulation of a finger's extensor hood and its bones.",
)
app.add_typer(verify, name="verify")
app.add_typer(opensim, name="opensim")
app.command()(info)
app.command()(solve)
app.command()(export)
app.command()(moment_arms)
app.command()(mjcf)
app.command("import")(import_model)
app.command()(new)
app.command()(sto)
app.command()(fmu)
app.command()(report)
app.command()(validate)
app.command()(sensitivity)
app.command()(identify)
app.command()(study)
app.command()(status)
app.command()(reproduce)
app.command("hood")(show_hood)
app.command()(estimate)
app.command()(ladder)
app.command()(lesion)
app.command()(reduce)
UNFINISHED = ".unfinished"
Voice = Literal["plain", "quiet", "json"]
Quiet = Annotated[bool, typer.Option("--quiet", help="Say nothing but what is wrong.")]
AsJson = Annotated[
    bool, typer.Option("--json", help="Tell stages and results as lines of JSON, for machines.")
]
Cases = Annotated[list[str], typer.Argument(help="Case files, or names of packaged cases.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Replace a value of every case; repeatable."),
]


def main() -> None:
    """The program `cosim`."""
    prepare_process()
    for stream in (sys.stdout, sys.stderr):
        # A Windows pipe has a code page of 256 characters: what it lacks is shown as "?".
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    app(prog_name="cosim")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"cosim {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Say which.")
    ] = False,
) -> None:
    pass


def _load(names: Sequence[str], settings: Sequence[str] | None) -> list[Case]:
    """All cases; the faults of every one are told before the exit."""
    from cosim.case.file import load_case

    cases, faults = [], []
    for name in names:
        try:
            cases.append(load_case(name, settings or ()))
        except InputError as error:
            faults.append(error)
    if faults:
        raise typer.Exit(max([tell(fault) for fault in faults]))
    return cases


@app.command()
def run(
    cases: Cases,
    settings: Settings = None,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("runs"),
    restart: Annotated[
        bool, typer.Option("--restart", help="Begin motions anew of which a part is kept.")
    ] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Run cases; each leaves its results in a folder of its name."""
    checked = _load(cases, settings)
    with told():
        _check_targets(checked, out)
        if not restart:
            _check_unfinished(checked, out)
    _run_all(checked, out, _voice(quiet, as_json))


def _run_all(cases: Sequence[Case], out: Path, voice: Voice) -> None:
    """Run cases one after the other until the user stops one; their warnings, and what their audits
    missed, are said last."""
    summaries: dict[str, Mapping[str, Any] | None] = {}
    failed = 0
    for case in cases:
        try:
            summaries[case.name] = _run_one(case, out, voice)
        except CosimError as error:
            summaries[case.name] = None
            failed = max(failed, tell(type(error)(f"{case.name}: {error}")))
            if isinstance(error, StoppedError):
                break
    if voice == "plain" and len(cases) > 1:
        from cosim.results.summary_tables import batch_table

        console().print(batch_table([case.name for case in cases], summaries))
    warn({name: (summary or {}).get("warnings", ()) for name, summary in summaries.items()})
    missed = warn_of_audits({n: list(describe_misses(s or {})) for n, s in summaries.items()})
    raise typer.Exit(failed or missed)


def _voice(quiet: bool, as_json: bool) -> Voice:
    if quiet and as_json:
        raise typer.BadParameter("--quiet and --json: one of the two")
    return "quiet" if quiet else "json" if as_json else "plain"


def _check_targets(cases: Sequence[Case], out: Path) -> None:
    from cosim.results.write import check_target

    names = [case.name for case in cases]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"two cases are named {', '.join(twice)}: run them one by one with --out")
    for name in names:
        check_target(out, name)


def _run_one(case: Case, out: Path, voice: Voice) -> Mapping[str, Any]:
    """Run, write and show one case; its summary.  Raises CosimError."""
    from cosim.pipeline import run_case
    from cosim.results.write import write_result

    unfinished = _unfinished(case, out)
    try:
        with _progress(case.name, voice) as say:
            result = run_case(case, say, unfinished)
            say("writing the results")
            folder = write_result(out, case, result)
    except KeyboardInterrupt:
        raise StoppedError(f"stopped before its end; {_what_stays(unfinished)}") from None
    except ConvergenceError:
        _forget(unfinished)  # it would fail again where it failed
        raise
    _forget(unfinished)
    if voice == "json":
        line = {"case": case.name, "results": str(folder), "summary": result.summary}
        typer.echo(json.dumps(line, default=float))
    elif voice == "plain":
        _show(case, result.summary)
        typer.echo(f"results in {_shown(folder)}")
    return result.summary


def _keeps_checkpoints(case: Case) -> bool:
    return case.forward is not None and case.forward.checkpoint != 0 and case.hood.kind != "split"


def _what_stays(unfinished: Path | None) -> str:
    from cosim.coupling.checkpoint import NAME

    if unfinished is None or not (unfinished / NAME).is_file():
        return "nothing of this run is kept"
    return f"what was kept before stays. Go on with: cosim resume {_shown(unfinished)}"


def _forget(unfinished: Path | None) -> None:
    if unfinished is not None:
        shutil.rmtree(unfinished, ignore_errors=True)


def _unfinished(case: Case, out: Path) -> Path | None:
    """The folder where a motion keeps its checkpoints until it has ended, with its case in it; None
    for a case that keeps none.  Raises InputError where it cannot be made."""
    if not _keeps_checkpoints(case):
        return None
    from cosim.case.file import resolved_toml
    from cosim.files import written_whole

    folder = out / f"{case.name}{UNFINISHED}"
    if case.source.parent.resolve() != folder.resolve():  # not resumed: from the start
        shutil.rmtree(folder, ignore_errors=True)
        with written_whole(folder / "case.toml") as part:
            part.write_text(resolved_toml(case), encoding="utf-8")
    return folder


def _check_unfinished(cases: Sequence[Case], out: Path) -> None:
    """Raises InputError for a motion of which a part is kept, which a new run would throw away."""
    from cosim.case.file import resolved_toml
    from cosim.coupling.checkpoint import NAME

    for case in filter(_keeps_checkpoints, cases):
        folder = out / f"{case.name}{UNFINISHED}"
        if not (folder / NAME).is_file():
            continue
        if (folder / "case.toml").read_text(encoding="utf-8") == resolved_toml(case):
            raise InputError(
                f"{_shown(folder)}: holds a part of this run, which was stopped or killed. Go on "
                f"with: cosim resume {_shown(folder)}; or add --restart to begin anew"
            )


@app.command()
def resume(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run that was cut off.")],
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Go on with a coupled motion that was stopped or killed, from its last checkpoint."""
    from cosim.case.file import load_case

    name = run.name.removesuffix(UNFINISHED)
    with told():
        file = run.with_name(name + UNFINISHED) / "case.toml"
        if not file.is_file():
            raise InputError(
                f"{run}: nothing was cut off here: only a coupled motion that was stopped or "
                f"killed leaves a folder RUN{UNFINISHED}"
            )
        case = load_case(file).model_copy(update={"name": name})
    _run_all([case], run.parent, _voice(quiet, as_json))


@contextmanager
def _progress(name: str, voice: Voice) -> Iterator[Callable[[str], None]]:
    """What tells of the stages: a spinner on a terminal, else a line for each; or lines of JSON,
    or nothing."""
    if voice == "quiet":
        yield lambda stage: None
        return
    if voice == "json":
        yield lambda stage: typer.echo(json.dumps({"case": name, "stage": stage}))
        return
    if not sys.stderr.isatty():
        yield lambda stage: typer.echo(f"{name}: {stage}", err=True)
        return
    from rich.console import Console

    with Console(stderr=True).status(name) as status:
        yield lambda stage: status.update(f"{name}: {stage}")


def _show(case: Case, summary: Mapping[str, Any]) -> None:
    from cosim.results.summary_tables import tables

    printer = console()
    printer.print(f"\n{case.name}: {case.title}")
    for table in tables(summary):
        printer.print(table)


def _shown(path: Path) -> str:
    try:
        return min(str(path), os.path.relpath(path), key=len)
    except ValueError:  # another drive
        return str(path)


@app.command()
def check(cases: Cases, settings: Settings = None) -> None:
    """Check cases, and the mesh files that they name, and run nothing."""
    from cosim.build.fit import check_fit
    from cosim.build.models import check_mesh_file

    codes = [0]
    for case in _load(cases, settings):
        try:
            check_fit(case)
            check_mesh_file(case)
            typer.echo(f"{case.name}: in order")
        except InputError as error:
            codes.append(tell(InputError(f"{case.name}: {error}")))
    raise typer.Exit(max(codes))


@app.command()
def schema() -> None:
    """Print the JSON Schema of a case file, for editors."""
    from cosim.case.file import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))


@app.command()
def view(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
) -> None:
    """Show a run's hood in a window."""
    with told():
        hood = folder / "hood.vtu"
        if not (folder / "summary.json").is_file():
            raise InputError(
                f"{folder}: is not the folder of a run; for example runs/isometric_edc"
            )
        if not hood.is_file():
            raise InputError(f"{folder}: this run has no deformable hood to show")
        if not _has_display():
            picture = folder / "picture.png"
            there = f"the picture is {picture}" if picture.is_file() else "nor was a picture made"
            typer.echo(f"there is no display here; {there}")
            return
        _open_window(hood)


def _has_display() -> bool:
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _open_window(hood: Path) -> None:
    import pyvista

    from cosim.results.data import STRAIN

    mesh = pyvista.read(hood)
    plotter = pyvista.Plotter(title=f"cosim: {hood.parent.name}")
    if STRAIN in mesh.cell_data:
        percent = 100 * mesh.cell_data[STRAIN]
        most = float(abs(percent).max())
        bar: Any = {"title": "longitudinal strain, %"}
        plotter.add_mesh(
            mesh,
            scalars=percent,
            cmap="RdBu_r",
            clim=(-most, most),
            show_edges=True,
            scalar_bar_args=bar,
        )
    else:
        plotter.add_mesh(mesh, show_edges=True)
    plotter.show()


@app.command()
def bench(
    case: Annotated[
        str,
        typer.Argument(
            help="Case file or packaged case; or fe, febio, fingers, opensim, robot, studies."
        ),
    ],
    settings: Settings = None,
    models: Annotated[
        Path | None, typer.Option(help="Of febio: folder of the models with published figures.")
    ] = None,
    spacing: Annotated[
        str, typer.Option(help="Of febio: of the grids for the distances of the bones.")
    ] = "0.25 mm",
) -> None:
    """Time a coupled run against one assembly and one factorisation of its own tangent; with fe the
    shell solver's iteration against its floor; with febio published models beside FEBio; with
    fingers the static solve of the finger alone; with opensim its motion beside OpenSim's; with
    robot the control loop of the robotic finger beside its paper's; with studies what it costs to
    hand out runs, and two workers beside one."""
    if case == "fe":
        bench_fe()
        return
    if case in ("fingers", "opensim"):
        with told():
            bench_fingers(beside_opensim=case == "opensim")
        return
    if case == "robot":
        bench_robotic_finger()
        return
    if case == "studies":
        with told():
            bench_studies()
        return
    if case == "febio":
        with told():
            bench_febio(models, spacing)
        return
    (checked,) = _load([case], settings)
    from cosim.commands.bench_case import bench_case

    with told():
        for name, value in bench_case(checked).items():
            typer.echo(f"{name:<20} {value:.4g}")


@app.command()
def mesh(
    case: Annotated[str, typer.Argument(help="Case file, or name of a packaged case.")],
    settings: Settings = None,
    out: Annotated[Path, typer.Option(help="The mesh file to write.")] = Path("hood.json"),
) -> None:
    """Write the hood mesh of a case, for hood.mesh.kind = "file"."""
    (checked,) = _load([case], settings)
    with told():
        from cosim.build.models import hood_mesh
        from meshes.hood_mesh import write

        made = hood_mesh(checked)
        try:
            write(made, out)
        except OSError as error:
            raise InputError(f"{out}: cannot be written ({error.strerror})") from error
        typer.echo(f"{len(made.quads)} quads in {_shown(out)}")


if __name__ == "__main__":
    main()
