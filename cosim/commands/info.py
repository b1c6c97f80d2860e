"""`cosim info`."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from importlib.metadata import version
from typing import Annotated

import typer

from cosim.array_cache import OFF, ArrayCache, Contents, user_cache
from cosim.array_cache import VARIABLE as VARIABLE_OF_CACHE
from cosim.commands.options import option
from cosim.extras import DISTRIBUTIONS, EXTRAS, install_command, is_installed
from cosim.files import shown_path
from cosim.version import __version__
from fe_solver.elements import kernels
from fe_solver.solver.linear_algebra import BACKENDS, FASTER, VARIABLE, available, backend_name

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
    "notebooks": EXTRAS["notebooks"],
    "documentation": EXTRAS["docs"],
}
"""Libraries that serve one purpose; they are imported when it is asked for."""


def info(
    clear_cache: Annotated[
        bool, option("Empty the cache of arrays, and say what that freed.", "--clear-cache")
    ] = False,
    warm: Annotated[
        bool,
        option(
            "Compile the kernels and bake the distances of the bones of the shipped cases, so "
            "that no later run waits: after an installation, or while a container is built.",
            "--warm",
        ),
    ] = False,
) -> None:
    """What is installed and in use, what is kept in the user's cache, and what would be faster."""
    if clear_cache:
        typer.echo(_clear_cache())
    if warm:
        from cosim.commands.warm import warm_everything

        warm_everything()
    if clear_cache or warm:
        return
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
