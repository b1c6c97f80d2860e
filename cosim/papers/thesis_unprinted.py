"""What the thesis does not print of its sheet, and what that changes in the strains of table 5."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
import pandas as pd

from cosim.case.file import load_case
from cosim.hoods.shell.table import ShellHoodConfig
from cosim.papers.thesis_models import DIRECTIONS, STATISTICS, hood_run
from cosim.papers.thesis_rows import printed_numbers
from cosim.report.figures import Figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

CASE = "thesis_strain_soft"
COLUMNS = tuple(f"{s}_percent" for s in STATISTICS)
COLOURS = ("#0b5394", "#c2410c")
AS_IS = "as it is"


def variants() -> dict[str, tuple[str, ...]]:
    """Settings by what they change; none was chosen by what comes of it."""
    hood = cast(ShellHoodConfig, load_case(CASE).hood)
    return {
        AS_IS: (),
        "twice as thick": (f'hood.thickness="{2e3 * hood.thickness:g} mm"',),
        "free of stress at 10/20/5 deg": _rest_posture(10, 20, 5),
        "free of stress at 20/40/11 deg": _rest_posture(20, 40, 11),
        "Poisson's ratio 0.49": tuple(f"hood.regions.{r}.poisson=0.49" for r in hood.regions),
    }


def _rest_posture(*angles: int) -> tuple[str, ...]:
    return tuple(
        f'hood.mesh.rest_posture.{joint}="{angle} deg"'
        for joint, angle in zip(("MCP", "PIP", "DIP"), angles, strict=True)
    )


def unprinted_figures() -> list[Figure]:
    """Strains over the central region with soft moduli, by what is assumed of the sheet."""
    printed = printed_numbers()
    thesis = {d: tuple(printed[f"strain.soft.{d}.{s}"] for s in STATISTICS) for d in DIRECTIONS}
    runs = {name: hood_run(CASE, *settings).summary for name, settings in variants().items()}
    strains = {
        "thesis": thesis,
        **{
            name: {d: tuple(said["strain_percent"][d][s] for s in STATISTICS) for d in DIRECTIONS}
            for name, said in runs.items()
        },
    }
    table = pd.DataFrame(
        [
            {"sheet": name, "direction": d} | dict(zip(COLUMNS, strain[d], strict=True))
            for name, strain in strains.items()
            for d in DIRECTIONS
        ]
    )

    def draw(sheet: Sheet) -> None:
        every = sheet.subplots(1, 2, sharey=True)
        place = np.arange(len(strains))
        for axes, direction, colour in zip(every, DIRECTIONS, COLOURS, strict=True):
            low, mean, high = np.array([strain[direction] for strain in strains.values()]).T
            axes.hlines(place, low, high, color=colour, lw=3)
            axes.plot(mean, place, "o", color=colour, mfc="white", mew=1.8)
            axes.axvline(0.0, color="0.8", lw=0.8)
            style_axes(axes, f"{direction} strain, %", "")
        every[0].set_yticks(place, list(strains))
        every[0].invert_yaxis()

    caption = (
        "Soft moduli, 11.8 N in EDC, finger straight; line from the least to the largest strain "
        "over the central region, circle: mean. The text does not print the sheet's thickness, "
        "its Poisson's ratio, or the posture of the finger whose images it was made from and in "
        "which it is free of stress. A sheet that is free of stress in a bent finger is squeezed "
        "when the finger is straight, which is the only one of these that makes negative "
        "longitudinal and positive lateral strains as the thesis has them; thickness scales all. "
        "So table 5 can neither be reproduced nor contradicted from the text; no variant was "
        "taken over into a case."
    )
    title = "What the thesis does not print: soft moduli, other sheets"
    return [Figure("unprinted", title, caption, draw, {"unprinted": table}, (9.0, 3.2))]
