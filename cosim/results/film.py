"""A run as a film: its frames as pictures to one scale, without a display and without VTK."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.errors import InputError
from cosim.extras import require
from cosim.files import output_file
from cosim.results.frames import Frame
from cosim.results.parts import Scene
from cosim.results.picture import data_address, load_matplotlib, palette_of
from cosim.results.scene_plot import Stage, draw_pixels, stage_of

if TYPE_CHECKING:
    from PIL.Image import Image

FPS, MOST_FPS = 12.0, 50.0
WIDTH, WIDTHS = 800, (200, 2400)
"""Pixels, and between what they may lie."""
STATE, HOLD = 1.5, 1.0
"""s that a state at rest is shown, and the last picture of a motion longer than the others."""
COLOURS = 256
"""Colours of a gif."""


@dataclass(frozen=True)
class Film:
    """Pictures of a run in order, to one scale and within one frame; a notebook plays them."""

    title: str
    shown: Sequence[tuple[Scene, str, float]]
    """Each picture: what there is to see, when (in words), and how long it is shown, s."""
    stage: Stage
    fps: float
    width: int
    """Pixels."""

    @property
    def seconds(self) -> float:
        """How long it takes, s."""
        return sum(seconds for _, _, seconds in self.shown)

    def images(self) -> Iterator[Image]:
        """Draw the pictures one by one, all of one size in pixels, which is even."""
        from PIL import Image

        load_matplotlib()
        moments = ((scene, moment) for scene, moment, _ in self.shown)
        for pixels in draw_pixels(moments, self.title, self.stage, self.width):
            tall, wide = (n - n % 2 for n in pixels.shape[:2])
            yield Image.fromarray(pixels[:tall, :wide])

    def gif(self) -> bytes:
        """The film as the content of a GIF file, which plays again and again."""
        from PIL import Image

        every = list(self.images())
        palette = palette_of([every[k] for k in (0, len(every) // 2, -1)], COLOURS)
        first, *others = (i.quantize(palette=palette, dither=Image.Dither.NONE) for i in every)
        out = BytesIO()
        durations = [round(1000 * seconds) for _, _, seconds in self.shown]
        about: dict[str, Any] = {"duration": durations, "loop": 0, "optimize": False}
        first.save(out, "GIF", save_all=True, append_images=others, **about)
        return out.getvalue()

    def write(self, path: Path) -> None:
        """Write a .gif, or with the extra `film` a .mp4.  Raises InputError."""
        check_film_file(path)
        with output_file(path) as part:
            if path.suffix.lower() == ".mp4":
                self._write_mp4(part)
            else:
                part.write_bytes(self.gif())

    def _write_mp4(self, path: Path) -> None:
        import imageio_ffmpeg

        writer = None
        for image, (_, _, seconds) in zip(self.images(), self.shown, strict=True):
            if writer is None:
                form: Any = {"fps": self.fps, "macro_block_size": 2, "output_params": ["-f", "mp4"]}
                writer = imageio_ffmpeg.write_frames(str(path), image.size, **form)
                writer.send(None)
            for _ in range(max(1, round(seconds * self.fps))):
                writer.send(image.tobytes())
        if writer is not None:
            writer.close()

    def _repr_html_(self) -> str:
        """A notebook's view: the film, playing."""
        address = data_address(self.gif(), "image/gif")
        return f'<img alt="film of the run" src="{address}" style="max-width:100%">'


def check_film_file(path: Path) -> None:
    """Check that a film can be written to such a file.  Raises InputError."""
    ending = path.suffix.lower()
    if ending not in (".gif", ".mp4"):
        raise InputError(f"{path}: a film is a .gif or a .mp4")
    if ending == ".mp4":
        require("a film as .mp4 (a .gif needs no more)", "imageio_ffmpeg")


def film_of(
    title: str,
    frames: Sequence[Frame],
    scenes: Sequence[Scene],
    fps: float = FPS,
    speed: float | None = None,
    width: int = WIDTH,
) -> Film:
    """Return the film of a run's frames, which `scenes` show: `fps` pictures a second, a motion
    `speed` times as fast as it was, or without a speed each of its frames once.

    Raises InputError for a run of one frame, and for numbers out of range."""
    for name, value, low, high in (
        ("fps", fps, 0.5, MOST_FPS),
        ("speed", 1.0 if speed is None else speed, 1e-6, 1e6),
        ("width", width, *WIDTHS),
    ):
        if not low <= value <= high:
            raise InputError(f"{name} = {value:g}: lies between {low:g} and {high:g}")
    if len(frames) < 2:
        raise InputError("this run has one frame only; a film needs two or more")
    times = [frame.time for frame in frames if frame.time is not None]
    if len(times) == len(frames):
        order = _paced(np.array(times), fps, speed)
    else:
        order = [(k, STATE) for k in range(len(frames))]
    stage = stage_of([scenes[k] for k, _ in order])
    shown = [(scenes[k], _moment(frames[k], stage), seconds) for k, seconds in order]
    return Film(title, shown, stage, fps, int(width))


def _paced(times: np.ndarray, fps: float, speed: float | None) -> list[tuple[int, float]]:
    """The frames at `times` s that a film shows, and for how long each, s: those nearest to evenly
    spaced times."""
    if speed is None:
        chosen = np.arange(len(times))
    else:
        count = max(2, round((times[-1] - times[0]) / speed * fps) + 1)
        wanted = np.linspace(times[0], times[-1], count)
        chosen = np.abs(times[None] - wanted[:, None]).argmin(axis=1)
    frames, repeats = np.unique(chosen, return_counts=True)
    seconds = repeats / fps
    seconds[-1] += HOLD
    return list(zip(frames.tolist(), seconds.tolist(), strict=True))


def _moment(frame: Frame, stage: Stage) -> str:
    """When a picture is, and the force of a fingertip that bears one at some time."""
    force = float(np.linalg.norm(frame.force))
    return f"{frame.label}, force of the fingertip {force:.2f} N" if stage.newtons else frame.label
