"""Studies: a case solved for many values of its parameters, on one machine or many.

In a notebook:

    from cosim.study import open_study
    study = open_study("studies/network_saltelli")
    study.table            # pandas: a row for each run
    study.dataset()        # xarray: axes and arrays
    study.indices("tip_force")
    study.surrogate("tip_force")  # a Gaussian process, with its Q2
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cosim.study.results import StudyResults


def open_study(folder: str | Path) -> StudyResults:
    """What `cosim study` left in a folder.  Raises InputError where it left nothing there."""
    from cosim.study.results import read_study

    return read_study(Path(folder))
