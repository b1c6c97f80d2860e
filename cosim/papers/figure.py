"""A figure of a paper, computed anew: its numbers, what it asserts, and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import pandas as pd

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet


@dataclass(frozen=True)
class Figure:
    """One picture with the table behind it.  `draw` fills a fresh matplotlib figure of `size`
    inches; `tables` by file name hold every number that is drawn, with units in their headings."""

    name: str
    """A file's name without its ending: "figure_3_contours"."""
    title: str
    caption: str
    """What is seen, what the paper says of it, and what is ours: assumptions, labels, misses."""
    draw: Callable[[Sheet], None] | None
    """None: a table alone."""
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    size: tuple[float, float] = (7.0, 4.5)


@dataclass(frozen=True)
class Study:
    """What `cosim reproduce` knows a figure by before it is computed."""

    name: str
    about: str
    figures: Callable[[], list[Figure]]
