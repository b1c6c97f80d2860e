"""`cosim verify` and `cosim info`."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pkgutil import resolve_name
from typing import Annotated, Any

import typer
from rich import box
from rich.table import Table

from cosim.array_cache import OFF, ArrayCache, Contents, user_cache
from cosim.array_cache import VARIABLE as VARIABLE_OF_CACHE
from cosim.checks import Row, Study, select_studies
from cosim.commands.terminal import console, exit_on_error, stages
from cosim.extras import DISTRIBUTIONS, EXTRAS, install_command, is_installed
from cosim.files import shown_path
from cosim.version import __version__
from fe_solver.elements import kernels
from fe_solver.solver.linear_algebra import BACKENDS, FASTER, VARIABLE, available, backend_name

verify = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Solve problems whose answers are known, and judge the program by them.",
)


AsJson = Annotated[bool, typer.Option("--json", help="Print the table as JSON.")]
Only = Annotated[
    str | None, typer.Option(metavar="NAME", help="Only the studies whose name contains this.")
]
Slow = Annotated[bool, typer.Option("--slow", help="Run the slow studies too.")]


PURPOSES = {
    "files": ("meshio", "lxml", "h5netcdf"),
    "pictures, pages": ("matplotlib", "plotly", "jinja2"),
    "a page to work in": EXTRAS["ui"],
    "windows, .vtu of others": EXTRAS["view"],
    "films as .mp4": EXTRAS["film"],
    "studies": EXTRAS["study"],
    "surrogates of studies": EXTRAS["surrogate"],
    "estimates": ("daqp",),
    "your own bones": ("trimesh",),
    "FMUs": ("fmpy", *EXTRAS["fmu"]),
    "environments of learners": EXTRAS["gym"],
    "checks by OpenSim": EXTRAS["opensim"],
    "packages of a validation": EXTRAS["package"],
    "notebooks": EXTRAS["notebooks"],
    "documentation": EXTRAS["docs"],
}
"""Libraries that serve one purpose; they are imported when it is asked for."""


PARTS = {
    "fe": ("Verify the shell solver", ("fe_solver.verification.table:STUDIES",)),
    "fingers": (
        "Verify fingers, muscles and devices, and compare them with experiments",
        ("rigid.verification.table:FINGER_STUDIES",),
    ),
    "hoods": (
        "Verify the hoods in lumped form and of cables, and compare them with their papers",
        (
            "rigid.verification.table:HOOD_STUDIES",
            "fe_solver.verification.cable_rows:STUDIES",
            "cosim.verification.reduction:STUDIES",
        ),
    ),
    "coupling": (
        "Verify the schemes that couple in time",
        (
            "cosim.verification.coupling:STUDIES",
            "cosim.verification.schemes_at_rest:STUDIES",
            "cosim.verification.thesis:STUDIES",
            "cosim.verification.fmu:STUDIES",
        ),
    ),
    "robot": (
        "Verify the pneumatic robotic finger: routing, air, estimation, control",
        ("rigid.verification.robot_rows:STUDIES", "rigid.verification.air_rows:STUDIES"),
    ),
    "studies": (
        "Verify that lesions show a clinic's signs, and lay published experiments on lengths and "
        'cuts beside the models (--only "lengths and cuts")',
        ("cosim.verification.lesions:STUDIES", "cosim.verification.lengths:STUDIES"),
    ),
}
"""By command what it does, and where its studies are, `module:name`."""


@verify.callback()
def _parts() -> None:
    pass


def _command(places: Sequence[str]) -> Callable[[bool, str | None, bool], None]:
    """The command that runs the studies of these places."""

    def run(as_json: AsJson = False, only: Only = None, slow: Slow = False) -> None:
        _verify([study for place in places for study in resolve_name(place)], as_json, only, slow)

    return run


for _name, (_text, _places) in PARTS.items():
    verify.command(_name, help=f"{_text}; exit code 1 when a row fails.")(_command(_places))


def _verify(studies: Sequence[Study], as_json: bool, only: str | None, slow: bool) -> None:
    with exit_on_error():
        studies = select_studies(only, slow, studies)
    rows: list[Row] = []
    with stages("verify", len(studies)) as progress:
        for study in studies:
            progress.begin(study.name)
            rows += list(study.rows())
    _print(rows, as_json)
    raise typer.Exit(0 if all(row.passed for row in rows) else 1)


ClearCache = Annotated[
    bool, typer.Option("--clear-cache", help="Empty the cache of arrays, and say what that freed.")
]


def info(clear_cache: ClearCache = False) -> None:
    """What is installed and in use, what is kept in the user's cache, and what would be faster."""
    if clear_cache:
        typer.echo(_clear_cache())
        return
    with exit_on_error():
        installed = dict(facts()) | dict(_for_purposes())
    wide = max(map(len, installed))
    for name, value in installed.items():
        typer.echo(f"{name:{wide}}  {value}")


def facts() -> Iterator[tuple[str, str]]:
    """Names and words of the version, the libraries, the kernels and the linear solver in use."""
    yield "cosim", f"{__version__} on Python {platform.python_version()}, {platform.machine()}"
    yield (
        "libraries",
        ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "mujoco")),
    )
    compiled = (
        f"numba {version('numba')}"
        if kernels.COMPILED
        else "plain numpy, several times slower (numba is absent or switched off)"
    )
    yield "kernels", f"{compiled}, {kernels.thread_count()} threads on large meshes"
    yield "linear solver", f"{backend_name()}, of {', '.join(available())}"
    yield "cache of arrays", _cache_text(user_cache())
    order = list(BACKENDS)
    better = [name for name in order[: order.index(backend_name())] if name in FASTER]
    words = [f"{b} (set {VARIABLE})" if b in available() else FASTER[b] for b in better]
    yield "faster would be", "; ".join(words) or "nothing that is known"


def _cache_text(cache: ArrayCache | None) -> str:
    """Where arrays are kept and how much of each kind."""
    if cache is None:
        return f"turned off ({VARIABLE_OF_CACHE}={OFF})"
    kinds = [f"{kind or 'of an older version'} {_size(n)}" for kind, n in cache.contents().items()]
    most = f"at most {cache.most_bytes / 1e6:.0f} MB"
    return f"{shown_path(cache.folder)}: {', '.join(kinds)}; {most}, see --clear-cache"


def _size(contents: Contents) -> str:
    return f"{contents.bytes / 1e6:.1f} MB in {contents.files} files"


def _clear_cache() -> str:
    cache = user_cache()
    if cache is None:
        return f"the cache of arrays is {_cache_text(cache)}: nothing was removed"
    freed, left = cache.clear(), sum(n.files for n in cache.contents().values())
    rest = f"; {left} files could not be removed" if left else ""
    return f"freed {_size(freed)} in {shown_path(cache.folder)}{rest}"


def _for_purposes() -> Iterator[tuple[str, str]]:
    for purpose, names in PURPOSES.items():
        absent = [name for name in names if not is_installed(name)]
        words = [
            f"{name} {version(DISTRIBUTIONS.get(name, name))}"
            for name in names
            if name not in absent
        ]
        for command in dict.fromkeys(map(install_command, absent)):
            of_one = (name for name in absent if install_command(name) == command)
            words.append(f"{', '.join(of_one)} (absent: {command})")
        yield f"for {purpose}", ", ".join(words)


def _print(rows: Sequence[Row], as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps([as_record(row) for row in rows], indent=2))
        return
    out = console()
    sources = list(dict.fromkeys(row.source for row in rows))
    out.print(rich_table(rows, sources))
    for number, source in enumerate(sources, 1):
        out.print(f"[{number}] {source}")
    failed = sum(not row.passed for row in rows)
    outside = sum(row.verdict == "outside" for row in rows)
    compared = f", {outside} outside an experiment's spread" if outside else ""
    out.print(f"{len(rows)} rows, {failed} failed{compared}")


def as_record(row: Row) -> dict[str, Any]:
    """A row for JSON: what is not a number is null."""
    record = asdict(row) | {"error": row.error, "verdict": row.verdict}
    return {key: _finite(value) for key, value in record.items()}


def _finite(value: Any) -> Any:
    if isinstance(value, str) or value is None:
        return value
    return float(value) if math.isfinite(value) else None


def rich_table(rows: Iterable[Row], sources: Sequence[str]) -> Table:
    """The rows, a name said once where it repeats and the source by its number; of a bound the
    target is the most allowed."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("name", ratio=1)
    table.add_column("quantity", ratio=1)
    for title in ("target", "computed", "error", "tolerance", "order", "verdict", "source"):
        table.add_column(title, justify="right", no_wrap=True)
    last = ""
    for row in rows:
        number = f"[{sources.index(row.source) + 1}]"
        table.add_row("" if row.name == last else row.name, row.quantity, *_figures(row), number)
        last = row.name
    return table


def _figures(row: Row) -> tuple[str, ...]:
    target, relative = f"{row.target:.5g}", row.measure in ("relative", "shown")
    if row.measure == "bound":
        target = f"<= {row.target + row.tolerance:.2g}"
    return (
        target,
        f"{row.computed:.5g}" if row.measure != "bound" else f"{row.computed:.2g}",
        "-" if row.measure == "bound" else _percent(row.error, relative),
        "-" if row.measure in ("bound", "shown") else _percent(row.tolerance, relative),
        "" if row.order is None else f"{row.order:.1f}",
        row.verdict,
    )


def _percent(value: float, relative: bool) -> str:
    if not relative or value == 0:
        return f"{value:.1g}"
    return f"{100 * value:.2f} %" if value >= 5e-5 else f"{value:.0e}"
