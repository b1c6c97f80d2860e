"""The maker of every page, of its template, and how numbers, scripts and pictures travel within."""

from __future__ import annotations

import base64
import gzip
import io
import re
from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any

import numpy as np

from cosim.json_text import json_text
from cosim.port import Array
from cosim.results.picture import data_address
from cosim.version import __version__

SECTION = re.compile(r'<section id="([^"]+)" data-contents="([^"]+)"')
"""A section with what the contents of its page call it."""
CONTENTS = "<!--contents-->"


def html_page(
    name: str,
    package: str = "cosim.report",
    filters: Mapping[str, Callable[..., str]] | None = None,
    /,
    **content: Any,
) -> str:
    """The page that the template of this name makes of its content; it stands beside the modules of
    a package, and all extend the report's frame `base.html.j2`.

    An unknown name is an error and never an empty place.  The contents follow from the sections."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package, ""), PackageLoader("cosim.report", "")]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.globals |= {"style": report_file("page.css"), "save": report_file("save.js")}
    environment.globals |= {"version": __version__, "contents": Markup(CONTENTS)}
    environment.filters |= {"sentence": lambda text: text[:1].upper() + text[1:], **(filters or {})}
    environment.globals["parts"] = environment.get_template("parts.html.j2").module
    text = environment.get_template(name).render(**content)
    links = "".join(f'<a href="#{at}">{words}</a>' for at, words in SECTION.findall(text))
    contents = f'<nav aria-label="Contents">{links}</nav>' if links else ""
    return text.replace(CONTENTS, contents)


def report_file(name: str) -> str:
    """A file of the report's own: the style sheet of every page, or a script."""
    return files("cosim.report").joinpath(name).read_text(encoding="utf-8")


DROPPED = 10
"""Bits of 23 that a packed number's mantissa loses, to take less room: it is right to 6e-5 of its
size."""
OF_MARKUP = str.maketrans("<&", ",.")
"""What stands for the two characters of base85 that HTML reads as its own."""


def floats(values: Array) -> dict[str, Any]:
    """Rounded single precision, little endian, in base64, with the shape."""
    bits = np.asarray(values, dtype="<f4").view("<u4")
    half, kept = np.uint32(1 << (DROPPED - 1)), np.uint32(2**32 - (1 << DROPPED))
    return {"s": np.shape(values), "b": _base64(((bits + half) & kept).astype("<u4"))}


def integers(values: np.ndarray) -> dict[str, Any]:
    """As `floats`, without sign, in `i` bytes each: 2 where all fit, else 4."""
    size = 2 if np.size(values) == 0 or np.max(values) < 2**16 else 4
    return {"s": np.shape(values), "i": size, "b": _base64(np.asarray(values, dtype=f"<u{size}"))}


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


def packed_picture(png: bytes) -> str:
    """A picture as a data address: each pixel as it is, in the smallest lossless format that
    browsers know.  Raises OSError for what is no picture."""
    from PIL import Image

    out = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").save(out, "WEBP", lossless=True)
    return data_address(out.getvalue(), "image/webp")


def packed(text: str) -> str:
    """A text for a script element: compressed, in base85, the same at every time.  `unpack` of
    page.js reads it."""
    content = gzip.compress(text.encode("utf-8"), 9, mtime=0)
    return base64.b85encode(content).decode("ascii").translate(OF_MARKUP)


def packed_json(content: Any) -> str:
    """Data as JSON, packed."""
    return packed(json_text(content, None, ensure_ascii=True, separators=(",", ":")))
