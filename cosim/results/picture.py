"""Figures as files: every picture that the program draws goes through here."""

from __future__ import annotations

import os
import sys
from base64 import b64encode
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from cosim.results.looks import INKS, TENDON

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image


def load_matplotlib() -> None:
    """Import matplotlib, also where MPLBACKEND names a backend that is not installed here, as a
    notebook of another environment hands it on."""
    if "matplotlib" in sys.modules:
        return
    backend = os.environ.pop("MPLBACKEND", None)
    import matplotlib

    if backend is not None:
        os.environ["MPLBACKEND"] = backend
        with suppress(ValueError):  # no backend of this environment
            matplotlib.rcParams["backend"] = backend


def show_in_notebooks() -> None:
    """Have a notebook show figures that end a cell as pictures, as it does once pyplot is imported;
    elsewhere, and where it knows how, change nothing."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    formatter = None if shell is None else shell.display_formatter.formatters["image/png"]
    if formatter is None:
        return
    from matplotlib.figure import Figure

    try:
        formatter.lookup_by_type(Figure)
    except KeyError:
        formatter.for_type(Figure, partial(as_png, dpi=100))


def new_picture(width: float = 7.0, height: float = 4.5) -> Figure:
    """An empty picture of this size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def as_plain_text(figure: Figure) -> Figure:
    """Return the figure with its texts as they stand: a `$` of a title begins no formula, and the
    numbers on logarithmic axes are none."""
    from matplotlib.text import Text
    from matplotlib.ticker import LogFormatter

    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        if axis.get_scale() in ("log", "symlog"):
            axis.set_major_formatter("{x:g}")
        if axis.get_scale() == "log":
            axis.set_minor_formatter(LogFormatter())
    for text in figure.findobj(Text):
        text.set_parse_math(False)
    return figure


def write_figure(
    figure: Figure, target: Path | IO[bytes], dpi: float, form: str = "png", **options: Any
) -> None:
    """Write a figure in a format of matplotlib's, whatever backend the environment names.

    A PNG is drawn once; `Figure.savefig` draws twice, first to nowhere."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    as_plain_text(figure)
    if form != "png" or options:
        figure.savefig(target, format=form, dpi=dpi, **options)
        return
    figure.set_dpi(dpi)
    # of 1 to 9: half of the time of 6, which is usual, for a file a tenth larger
    FigureCanvasAgg(figure).print_png(target, pil_kwargs={"compress_level": 3})


def as_png(figure: Figure, dpi: float) -> bytes:
    """Return a figure as the content of a PNG file."""
    out = BytesIO()
    write_figure(figure, out, dpi)
    return out.getvalue()


def palette_of(images: Sequence[Image], count: int) -> Image:
    """Return an image whose palette has at most `count` colours for pictures of one width: those of
    fibres and tendons, which cover too few pixels to be chosen, and the most telling others."""
    from matplotlib.colors import to_rgb
    from PIL import Image

    rare = [round(255 * part) for ink in (*INKS, TENDON, "#ffffff") for part in to_rgb(ink)]
    pixels = np.concatenate([np.array(image) for image in images])
    chosen = Image.fromarray(pixels).quantize(count - len(rare) // 3).getpalette() or []
    out = Image.new("P", (1, 1))
    out.putpalette([*chosen[: 3 * count - len(rare)], *rare])
    return out


def data_address(content: bytes, kind: str = "image/png") -> str:
    """Return the address of a content that stands in the page itself."""
    return f"data:{kind};base64,{b64encode(content).decode('ascii')}"


def picture_address(figure: Figure | None, dpi: float) -> str:
    """Return a figure as the address of a PNG that holds it; empty for none."""
    return "" if figure is None else data_address(as_png(figure, dpi))
