"""The pictures of the catalogue: `python -m cases.pictures [FAMILY ...]` draws them anew.

Each is of one case of its family as it ships, and lies in the family's folder as picture.png;
`fingers` draws the four fingers side by side into fingers.png, `left` a left hand into left.png.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cosim.case.file import load_case
from cosim.hoods.view import HoodField
from cosim.pipeline import run_case
from cosim.results.parts import Scene
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
    "ring": "ring_edc",
    "little": "little_edc",
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
FINGERS = ("isometric_edc", "hood_minorflex_edc", "ring_edc", "little_edc")
"""A case of each finger, from the index to the little one."""
STRAIGHT = (
    'finger.tip.kind="posture"',
    *(f"finger.posture.{joint}=0 deg" for joint in ("MCP", "PIP", "DIP")),
    'tendons.EDC={tension="3 N"}',
)
APART = 24e-3
"""m from finger to finger."""
MOST_BYTES = 80_000
MOST_WIDTH = 945


def draw(result: Result) -> Figure:
    """The course of a motion in time, or the loaded finger from two sides."""
    if result.axis == "time":
        from cosim.results.history_plot import draw_history

        return draw_history(result.data, result.title)
    from cosim.results.scene_plot import draw as draw_scene

    return draw_scene(result.scene, result.title)


def draw_fingers(scenes: Sequence[Scene]) -> Figure:
    """The fingers of a right hand side by side from the dorsal side, in one scale, each in the axes
    of its own metacarpal."""
    from cosim.results import scene_plot

    hoods = [scene.hood for scene in scenes if scene.hood is not None]
    ulnar = [np.array([0.0, -APART * i, 0.0]) for i in range(len(scenes))]
    first = np.cumsum([0, *(len(hood.points) for hood in hoods)])
    whole = HoodField(
        np.concatenate([hood.points + aside for hood, aside in zip(hoods, ulnar, strict=True)]),
        np.concatenate([hood.quads + n for hood, n in zip(hoods, first, strict=False)]),
        *(
            {name: np.concatenate([getattr(h, kind)[name] for h in hoods]) for name in known}
            for kind in ("point_data", "cell_data")
            for known in [getattr(hoods[0], kind)]
        ),
    )
    places = list(zip(scenes, ulnar, strict=True))
    scene = Scene(
        whole,
        tuple((name, v + aside, faces) for s, aside in places for name, v, faces in s.bones),
        tuple((name, points + aside) for s, aside in places for name, points in s.tendons),
    )
    stage = replace(scene_plot.stage_of([scene]), views=scene_plot.VIEWS[1:])
    title = "From bottom to top: index, middle, ring and little finger, straight, EDC 3 N"
    return scene_plot.draw(scene, title, stage)


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
    known = [*SHOWN, "fingers", "left"]
    if unknown := set(asked.families) - {*known}:
        parser.error(f"no family {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    for family in asked.families or known:
        if family == "fingers":
            straight = [run_case(load_case(name, STRAIGHT)).scene for name in FINGERS]
            figure, place = draw_fingers(straight), asked.out / "fingers.png"
        elif family == "left":
            left = load_case(SHOWN["isometric"], ['finger.hand="left"'])
            figure, place = draw(run_case(left)), asked.out / "left.png"
        else:
            figure = draw(run_case(load_case(SHOWN[family])))
            place = asked.out / family / "picture.png"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(picture := small_png(figure))
        print(f"{place}: {len(picture) / 1000:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
