"""The libraries that a run does not need, and the extra of the installation that brings each."""

from __future__ import annotations

from importlib.util import find_spec

from cosim.errors import InputError

EXTRAS = {
    "ui": ("starlette", "uvicorn"),
    "view": ("pyvista",),
    "film": ("imageio_ffmpeg",),
    "study": ("pyarrow", "SALib", "dask", "distributed"),
    "surrogate": ("sklearn",),
    "fmu": ("pythonfmu", "pythonfmu3"),
    "gym": ("gymnasium",),
    "opensim": ("opensim",),
    "mkl": ("pypardiso",),
    "peers": ("KratosMultiphysics",),
    "notebooks": ("jupytext", "nbconvert"),
    "docs": ("sphinx", "myst_parser", "furo"),
}
"""By extra of pyproject.toml the modules that it brings."""

DISTRIBUTIONS = {"sklearn": "scikit-learn"}
"""What pip calls a module, where that is not its own name."""


def is_installed(library: str) -> bool:
    """Whether Python finds the module; it is not imported."""
    return find_spec(library) is not None


def install_command(library: str) -> str:
    """The command that installs a library, typed where the README's is.

    >>> install_command("pyvista"), install_command("numpy")
    ("pip install '.[view]'", 'pip install .')
    """
    extras = [f"'.[{name}]'" for name, libraries in EXTRAS.items() if library in libraries]
    return f"pip install {extras[0] if extras else '.'}"


def require(purpose: str, *libraries: str) -> None:
    """Check that libraries of an extra are there before what needs them begins.

    Raises InputError with the purpose, the first that is absent, and the command to type."""
    for library in libraries:
        if not is_installed(library):
            raise InputError(
                f"{purpose} needs {library}, which is not installed: {install_command(library)}"
            )
