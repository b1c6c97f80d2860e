"""The pictures of the catalogue: `python -m cases.pictures [FAMILY ...]` draws them anew.

Each is of one case of its family as it ships, and lies in the family's folder as picture.png.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path
from typing import TYPE_CHECKING

from cosim.case.file import load_case
from cosim.pipeline import run_case
from cosim.results.picture import palette_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cosim.results.result import Result

FOLDER = Path(__file__).parent
SHOWN = {
    "isometric": "isometric_edc",
    "strain": "strain_lee2008_average_ti",
    "fingertip": "fingertip_fibres_edc",
    "free": "free_edc",
    "middle": "hood_minorflex_edc",
    "lumped": "split_edc",
    "cable": "cable_edc",
    "motion": "forward_edc",
    "lesion": "lesion_boutonniere_triangular",
    "lengths": "lengths_terminal_4mm",
    "papers": "thesis_strain_average",
    "robot": "robot_cable_extensor",
    "own": "own_edc",
}
"""The case that stands for each family."""
MOST_BYTES = 80_000
MOST_WIDTH = 945


def draw(result: Result) -> Figure:
    """The course of a motion in time, or the loaded finger from two sides."""
    if result.axis == "time":
        from cosim.results.history_plot import draw_history

        return draw_history(result.data, result.title)
    from cosim.results.scene_plot import draw as draw_scene

    return draw_scene(result.scene, result.title)


def small_png(figure: Figure, dpi: float = 90) -> bytes:
    """A PNG of at most MOST_BYTES and MOST_WIDTH pixels, in as many of 256, 128, 64, ... colours
    as that allows."""
    from PIL import Image

    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=min(dpi, MOST_WIDTH / figure.get_figwidth()))
    image = Image.open(drawn).convert("RGB")
    colours, found = 512, b""
    while colours > 8 and not 0 < len(found) < MOST_BYTES:
        colours //= 2
        out = io.BytesIO()
        reduced = image.quantize(palette=palette_of([image], colours), dither=Image.Dither.NONE)
        reduced.save(out, format="PNG", optimize=True)
        found = out.getvalue()
    return found


def main() -> None:
    """Draw the picture of each family that the command line names, or of all."""
    parser = argparse.ArgumentParser(prog="python -m cases.pictures", description=__doc__)
    parser.add_argument("families", nargs="*", metavar="FAMILY", help=", ".join(SHOWN))
    parser.add_argument("--out", type=Path, default=FOLDER, help="in place of the folder cases/")
    asked = parser.parse_args()
    if unknown := set(asked.families) - set(SHOWN):
        parser.error(f"no family {', '.join(sorted(unknown))}; there are {', '.join(SHOWN)}")
    for family in asked.families or SHOWN:
        picture = small_png(draw(run_case(load_case(SHOWN[family]))))
        place = asked.out / family / "picture.png"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(picture)
        print(f"{place}: {SHOWN[family]}, {len(picture) / 1000:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
