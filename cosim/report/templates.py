"""The templates of the pages: a name that is not there is a fault, never an empty place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Template


def template(
    package: str,
    name: str = "page.html.j2",
    filters: Mapping[str, Callable[..., str]] | None = None,
) -> Template:
    """The template of this name beside the modules of a package."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(package, ""),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= dict(filters or {})
    return environment.get_template(name)


def own_file(name: str) -> str:
    """A file of the report's own: the style sheet of every page, or a script."""
    return files("cosim.report").joinpath(name).read_text(encoding="utf-8")
