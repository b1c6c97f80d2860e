"""Sphinx's settings; `python -m cases.docs` lays the pages and builds them."""

from __future__ import annotations

import re
from dataclasses import is_dataclass
from typing import Any

from cosim.version import __version__

project = "cosim-hand"
author = project_copyright = "cosim-hand contributors"
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc"]
html_theme = "furo"
html_title = f"cosim-hand {release}"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_show_sourcelink = False
html_copy_source = False
myst_heading_anchors = 4
highlight_language = "none"  # of blocks that do not say theirs
default_role = "literal"  # docstrings mark code by single backticks
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("AnyCase", "Array", "Ints", "Mask", "Progress")}
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 80


def shorten(
    app: object,
    what: str,
    name: str,
    described: object,
    options: object,
    signature: str | None,
    returned: str | None,
) -> tuple[str | None, str | None]:
    """No signature for a dataclass, whose fields stand below it with their meaning; aliases by
    their bare names."""
    if what == "class" and is_dataclass(described):
        return "", None
    return _bare(signature), _bare(returned)


def _bare(text: str | None) -> str | None:
    return text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)


def setup(app: Any) -> None:
    app.connect("autodoc-process-signature", shorten)
