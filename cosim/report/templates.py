"""The templates of the pages: an unknown name is an error, never an empty place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import TYPE_CHECKING

from cosim.version import __version__

if TYPE_CHECKING:
    from jinja2 import Template


def template(
    package: str,
    name: str = "page.html.j2",
    filters: Mapping[str, Callable[..., str]] | None = None,
) -> Template:
    """The template of this name beside the modules of a package, or of the report, whose frame
    `base.html.j2` all pages extend."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package, ""), PackageLoader("cosim.report", "")]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.globals |= {"style": report_file("page.css"), "save": report_file("save.js")}
    environment.globals |= {"version": __version__}
    environment.filters |= dict(filters or {})
    return environment.get_template(name)


def report_file(name: str) -> str:
    """A file of the report's own: the style sheet of every page, or a script."""
    return files("cosim.report").joinpath(name).read_text(encoding="utf-8")
