"""A run in space, in a window of pyvista, where its frames play."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.hoods.kinds import colours_of
from cosim.hoods.view import HoodField
from cosim.port import Array
from cosim.results.looks import BONE, FORCE, PLAIN_HOOD, RESTING_TENDON, TENDON, colour_map
from cosim.results.parts import Scene
from cosim.results.scene import tension_of
from cosim.results.scene_plot import arrow_of, newtons_of, stage_of

if TYPE_CHECKING:
    from pyvista import Plotter, PolyData

PAUSE = 80
"""ms from frame to frame."""
BAR = {"n_labels": 5, "height": 0.1, "width": 0.5, "position_x": 0.25, "fmt": "%.1f"}
HELP = "space: play or stop; slider: choose"


class Player:
    """Shows the frames of a run in one plotter: what is there moves, and nothing is added."""

    def __init__(self, plotter: Any, scenes: Sequence[Scene], labels: Sequence[str]) -> None:
        self.plotter, self.labels, self.hand = plotter, labels, scenes[-1].hand
        self.scenes = [scene.in_own_frame() for scene in scenes]
        self.stage = stage_of(self.scenes)
        self.k, self.is_playing = len(scenes) - 1, False
        self.slider: Any = None
        self.frames = [self._meshes(k) for k in range(len(scenes))]
        self.meshes: dict[str, PolyData] = {}
        for name, mesh in (item for frame in self.frames for item in frame.items()):
            self.meshes.setdefault(name, mesh.copy())
        for name, mesh in self.meshes.items():
            plotter.add_mesh(mesh, name=name, **self._look(name))
        self.show(self.k)

    def show(self, k: int) -> None:
        """Show the k-th frame."""
        self.k = k
        shown = self.frames[k]
        for name, mesh in self.meshes.items():
            if name in shown:
                mesh.copy_from(shown[name])
            self.plotter.actors[name].SetVisibility(name in shown)
        newtons = newtons_of(self.scenes[k])
        pulls = [f"{name} {tension:.2f} N" for name, tension in self.scenes[k].pulled.items()]
        force = [f"force of the fingertip {newtons:.2f} N"] * bool(self.stage.newtons)
        words = "\n".join([self.labels[k], *force, *pulls])
        self.plotter.add_text(words, position="upper_left", font_size=10, name="moment")

    def step(self, _: int = 0) -> None:
        """Show the next frame, after the last the first, if the film is playing."""
        if self.is_playing:
            self.show((self.k + 1) % len(self.scenes))
            if self.slider is not None:
                self.slider.GetRepresentation().SetValue(self.k)
            self.plotter.render()

    def toggle(self) -> None:
        """Play or stop."""
        self.is_playing = not self.is_playing

    def choose(self, value: float) -> None:
        """Stop at the frame that the slider says."""
        self.is_playing = False
        self.show(round(value))

    def _meshes(self, k: int) -> dict[str, PolyData]:
        """What there is to see in the k-th frame, by name."""
        import pyvista

        scene = self.scenes[k]
        out = {f"bone {name}": _surface(v, faces) for name, v, faces in scene.bones}
        for pulled in (True, False):
            lines = [p for name, p in scene.tendons if (tension_of(scene, name) > 0) == pulled]
            if lines:
                out[f"tendons {pulled}"] = _lines(lines)
        if scene.hood is not None:
            out["hood"] = _hood(scene.hood)
        arrow = arrow_of(scene, self.stage.newtons)
        if arrow is not None:
            size = float(np.linalg.norm(arrow[1] - arrow[0]))
            out["force"] = pyvista.Arrow(start=arrow[0], direction=arrow[1] - arrow[0], scale=size)
        return out

    def _look(self, name: str) -> dict[str, Any]:
        kind = name.split()[0]
        if kind != "hood":
            colour = {"bone": BONE, "force": FORCE}.get(kind, TENDON if "True" in name else "")
            return {
                "color": colour or RESTING_TENDON,
                "smooth_shading": kind == "bone",
                "line_width": 4 if colour else 2,
            }
        hood = self.scenes[-1].hood
        assert hood is not None
        width = {"line_width": 4} if hood.quads.shape[1] == 2 else {"show_edges": True}
        if self.stage.limits is None:
            return {"color": PLAIN_HOOD, **width}
        colour_of = colours_of(hood)[0]
        return {
            "scalars": "shown",
            "cmap": list(colour_map(colour_of.is_signed)),
            "clim": self.stage.limits,
            "scalar_bar_args": BAR | {"title": f"{colour_of.words}\n"},
            **width,
        }


def player_of(scenes: Sequence[Scene], labels: Sequence[str], title: str) -> Player:
    """Return what plays all there is to see, from the radial side with distal to the left (of a
    left hand to the right), at the last frame.  A window has a slider where there are several; a
    motion plays."""
    import pyvista

    plotter: Any = pyvista.Plotter(title=title, off_screen=pyvista.OFF_SCREEN)
    player = Player(plotter, scenes, labels)
    _add_legend(plotter, player)
    is_left = player.hand == "left"
    plotter.add_axes(xlabel="distal", ylabel="ulnar" if is_left else "radial", zlabel="dorsal")
    low, high = player.stage.box
    plotter.view_vector((0.0, -1.0 if is_left else 1.0, 0.0), viewup=(0.0, 0.0, 1.0))
    plotter.reset_camera(bounds=np.stack([low, high], axis=1).ravel().tolist())
    plotter.camera.zoom(1.35)
    if len(scenes) > 1 and not plotter.off_screen:
        _add_controls(plotter, player)
    return player


def plotter_of(scenes: Sequence[Scene], labels: Sequence[str], title: str) -> Plotter:
    """Return the plotter of `player_of`."""
    plotter: Plotter = player_of(scenes, labels, title).plotter
    return plotter


def _add_controls(plotter: Any, player: Player) -> None:
    """A slider, a timer and a key that play the frames."""
    last = len(player.scenes) - 1
    places = {"pointa": (0.3, 0.92), "pointb": (0.65, 0.92)}
    player.slider = plotter.add_slider_widget(
        player.choose, (0, last), value=last, title=HELP, fmt="%.0f", **places
    )
    plotter.add_key_event("space", player.toggle)
    plotter.add_timer_event(max_steps=10**9, duration=PAUSE, callback=player.step)
    player.is_playing = last > 1


def _add_legend(plotter: Any, player: Player) -> None:
    """What is drawn beside bones and hood, each in its colour."""
    entries = {
        "tendons True": ["tendons that pull", TENDON],
        "tendons False": ["tendons at rest", RESTING_TENDON],
        "force": ["force of the fingertip", FORCE],
    }
    drawn = [e for key, e in entries.items() if any(n.startswith(key) for n in player.meshes)]
    for i, (words, colour) in enumerate(drawn):
        place = (0.72, 0.95 - 0.04 * i)
        plotter.add_text(words, position=place, viewport=True, color=colour, font_size=10)


def _surface(points: Array, cells: np.ndarray) -> PolyData:
    import pyvista

    sized = np.column_stack([np.full(len(cells), cells.shape[1]), cells])
    return pyvista.PolyData(points, faces=sized.ravel())


def _lines(lines: Sequence[Array]) -> PolyData:
    import pyvista

    starts = np.cumsum([0, *map(len, lines)])
    cells = [[len(p), *range(a, a + len(p))] for a, p in zip(starts, lines, strict=False)]
    return pyvista.PolyData(np.concatenate(lines), lines=np.concatenate(cells))


def _hood(hood: HoodField) -> PolyData:
    """The hood with what colours it as `shown`."""
    import pyvista

    if hood.quads.shape[1] == 2:
        lines = np.column_stack([np.full(len(hood.quads), 2), hood.quads])
        mesh = pyvista.PolyData(hood.points, lines=lines.ravel())
    else:
        mesh = _surface(hood.points, hood.quads)
    if colours := colours_of(hood):
        mesh.cell_data["shown"] = colours[0].values(hood)
    return mesh
