"""The result of a run, computed or read back from its folder: one class."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from cosim.case.file import case_of, load_case
from cosim.case.schema import Case
from cosim.errors import InputError, unexpected
from cosim.extras import require
from cosim.files import output_file, path_from
from cosim.results.answer import answer, doubts, trust
from cosim.results.audit import Audit
from cosim.results.compare import Comparison, numbers_of, unit_of
from cosim.results.conventions import COMPONENTS, by_axis
from cosim.results.film import FPS, WIDTH, Film, film_of
from cosim.results.frames import Frame, frames_of, read_shapes
from cosim.results.history_plot import draw_history
from cosim.results.ledger_plot import draw_ledger
from cosim.results.parts import CaseParts, Scene
from cosim.results.picture import (
    as_plain_text,
    as_png,
    data_address,
    load_matplotlib,
    show_in_notebooks,
    write_figure,
)
from cosim.results.quantities import meaning_of
from cosim.results.scene import scenes_of
from cosim.results.scene_plot import VIEWS, Stage, draw, stage_of
from cosim.results.scene_view import plotter_of
from cosim.results.summary_tables import rows_of
from cosim.results.table import ReportTable
from cosim.results.write import copy_run, write_run
from cosim.schema.fields import is_number

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure
    from pyvista import Plotter


Plot = Literal["scene", "ledger", "history"]
View = Literal["both", "radial", "dorsal"]
SIDES = {"both": VIEWS, "radial": VIEWS[:1], "dorsal": VIEWS[1:]}


@dataclass(frozen=True, repr=False)
class Result(CaseParts):
    """What `cosim.run` found, or what `cosim.open_run` read: the same either way.

    >>> import cosim
    >>> result = cosim.run(cosim.load("pulley_edc"))
    >>> sorted(result.tip_force)
    ['distal', 'dorsal', 'radial']
    >>> result.audit.passed
    True
    """

    name: str
    """The case's; of runs that were read together and share it, with the folder they lie in."""
    folder: Path | None = None
    """Where it was written or read; None before."""
    comparison: tuple[Comparison, ...] = ()
    """With values that were given, of a run that was read."""

    @property
    def ledger(self) -> pandas.DataFrame:
        """Every force on every body by its source: state, body, source, force (N) and moment about
        the body's origin (N m), world axes."""
        import pandas

        vectors = [(*row.force, *row.moment) for row in self.rows]
        labels = [(row.state, row.body, row.source) for row in self.rows]
        left = pandas.DataFrame(labels, columns=["state", "body", "source"])
        return left.join(pandas.DataFrame(vectors, columns=COMPONENTS))

    @property
    def tip_force(self) -> dict[str, float]:
        """The force of the fingertip on the world (N) at the end, along the world's axes."""
        return by_axis(self.data.tip_force.isel({self.axis: -1}).values)

    @property
    def slips(self) -> dict[str, float]:
        """The forces in the central and the terminal slip (N) at the end; empty of a hood without
        slips."""
        return dict(self.summary.get("slip_force_N", {}))

    @property
    def excursions(self) -> dict[str, float]:
        """Excursions (mm) by tendon of the hood, positive proximally, from the hood's rest (of a
        motion: its start)."""
        stated = self.summary.get("excursion_mm", {})
        return {t: nan if mm is None else float(mm) for t, mm in stated.items()}

    @property
    def moment_arms(self) -> pandas.DataFrame:
        """Moment arms (mm), a row for each tendon and a column for each joint; flexion and radial
        abduction are positive.  Empty of a motion."""
        import pandas

        return pandas.DataFrame(self.summary.get("moment_arm_mm", {})).T

    @property
    def strain(self) -> pandas.DataFrame:
        """%, of the hood's central region: 5th percentile, mean and 95th percentile over its area,
        a column each, along the finger (longitudinal) and across it (lateral).  Empty of a hood
        without a sheet."""
        import pandas

        table = pandas.DataFrame(self.summary.get("strain_percent", {})).T
        return table.drop(columns=["min", "max"], errors="ignore")

    @property
    def joint_torques(self) -> pandas.DataFrame:
        """Torques about each joint (N mm), a row for each source; those of one joint add up to
        zero."""
        import pandas

        return pandas.DataFrame(self.summary.get("joint_torque_Nmm", {})).T

    @property
    def joint_forces(self) -> pandas.DataFrame:
        """Bone-to-bone forces (N), a row for each joint: what the bone distal of it receives from
        the one proximal of it through their contact, along the world's axes.  Empty of a motion and
        of a finger in an FMU."""
        import pandas

        return pandas.DataFrame(self.summary.get("joint_force_N", {})).T

    @property
    def quantities(self) -> pandas.DataFrame:
        """Every number of the summary, a row for each by its path (keys joined by dots): value,
        unit and meaning.

        >>> import cosim
        >>> table = cosim.run(cosim.load("pulley_edc")).quantities
        >>> table.loc["tension_N.EDC", "unit"], table.loc["tension_N.EDC", "meaning"]
        ('N', 'tension of EDC')
        """
        import pandas

        values = numbers_of(self.summary)
        rows = [(v, unit_of(path), meaning_of(path, self.summary)) for path, v in values.items()]
        return pandas.DataFrame(rows, index=list(values), columns=["value", "unit", "meaning"])

    @property
    def audit(self) -> Audit:
        """Each figure of the audit with its bound."""
        return Audit.read(self.summary)

    def plot(
        self,
        kind: Plot = "scene",
        path: str | Path | None = None,
        *,
        width_mm: float | None = None,
        view: View = "both",
        hood_only: bool = False,
        beside: Sequence[Result] = (),
    ) -> Figure:
        """A matplotlib figure, written to `path` (.png, .svg, .pdf) where one is given: "scene" the
        finger with its hood coloured by strain, "ledger" the forces on each body by source,
        "history" angles and forces over time, of a motion or of a load that is held.  Of the scene:
        `width_mm` of the whole figure, as a journal's column; one `view`, "radial" or "dorsal", or
        both; `hood_only`, without bones, tendons and forces; `beside`: results whose pictures,
        drawn beside each other, share one scale of lengths, colours and forces.

        >>> import cosim
        >>> figure = cosim.run(cosim.load("pulley_edc")).plot()
        >>> len(figure.axes)
        2

        Raises InputError for a kind that this run does not have, or a file that cannot be
        written."""
        if not isinstance(kind, str):
            raise unexpected("kind", "'scene', 'ledger' or 'history'", kind)
        path = None if path is None else path_from("path", path)
        stage = self._stage(kind, width_mm, view, hood_only, beside)
        figure = as_plain_text(self._figure(kind, stage, hood_only))
        if path is not None:
            known, ending = (
                figure.canvas.get_supported_filetypes(),
                Path(path).suffix.removeprefix(".").lower() or "png",
            )
            if ending not in known:
                raise InputError(
                    f"{path}: a figure is not written as {ending!r}; {', '.join(known)} are known"
                )
            with output_file(Path(path)) as part:
                write_figure(figure, part, 150, ending)
        return figure

    def _stage(
        self,
        kind: Plot,
        width_mm: float | None,
        view: View,
        hood_only: bool,
        beside: Sequence[Result],
    ) -> Stage | None:
        """What the scene is drawn on.  Raises InputError, also for other kinds with options."""
        if kind != "scene":
            if (width_mm, view, hood_only, tuple(beside)) != (None, "both", False, ()):
                raise InputError("plot: width_mm, view, hood_only and beside are of the 'scene'")
            return None
        if view not in tuple(SIDES):
            raise unexpected("view", "'radial', 'dorsal' or 'both'", view)
        least = 110 if hood_only else 130  # names and legend keep their size
        if width_mm is not None and not (is_number(width_mm) and least <= width_mm <= 1000):
            raise unexpected("width_mm", f"a width in mm from {least} to 1000", width_mm)
        if isinstance(beside, Result) or not all(isinstance(run, Result) for run in beside):
            raise unexpected("beside", "a list of results", beside)
        scenes = [run._shown(hood_only) for run in (self, *beside)]
        if hood_only and scenes[0].hood is None:
            raise InputError(f"plot: hood_only: the hood of {self.name} has no shape to draw")
        stage = stage_of(scenes)
        width = None if width_mm is None else width_mm / 25.4
        views = tuple(side.of(self.hand) for side in SIDES[view])
        return replace(stage, whole=scenes[0], is_film=False, views=views, width=width)

    def _shown(self, hood_only: bool) -> Scene:
        whole = self._whole_scene
        if not hood_only:
            return whole
        return Scene(whole.hood, (), (), points=whole.points, gauges=whole.gauges, hand=whole.hand)

    def _figure(self, kind: Plot, stage: Stage | None, hood_only: bool) -> Figure:
        load_matplotlib()
        show_in_notebooks()
        if kind == "scene":
            return draw(self._shown(hood_only), self.title, stage)
        if kind == "ledger" and self.rows:
            return draw_ledger(self.rows, self.title, self._whole_scene)
        if kind == "history" and self.has_history:
            return draw_history(self.data, self.title)
        kinds = ["scene", *(["ledger"] * bool(self.rows)), *(["history"] * self.has_history)]
        raise InputError(f"plot: this run has no {kind!r}; it has {', '.join(kinds)}")

    def animate(
        self,
        path: str | Path | None = None,
        *,
        fps: float = FPS,
        speed: float | None = None,
        width: int = WIDTH,
    ) -> Film:
        """Return a film of the run's frames, which a notebook plays, and write it to `path` (.gif,
        or .mp4 with the extra `film`) where one is given: `fps` pictures a second, a motion `speed`
        times as fast as it was (without: each stored frame once), `width` pixels wide.

        Raises InputError for a run of one frame and for what cannot be written."""
        film = film_of(self.title, self.frames, self._film_scenes(), fps, speed, width)
        if path is not None:
            film.write(path_from("path", path))
        return film

    def view(self) -> Plotter:
        """Return a pyvista window's plotter with hood, bones, tendons and the force of the
        fingertip, metres, at the last frame; `.show()` opens it, with a slider over the frames, and
        plays a motion; `.screenshot(file)` needs no display with `off_screen`.  Raises InputError
        where pyvista is not installed."""
        require("a window in space", "pyvista")
        if self.axis == "time":
            return plotter_of(self._film_scenes(), [f.label for f in self.frames], self.title)
        scenes = [*self.scenes[:-1], self._whole_scene]
        return plotter_of(scenes, [frame.label for frame in self.frames], self.title)

    def _film_scenes(self) -> tuple[Scene, ...]:
        """`scenes`, without a hood whose shape was stored at the end only, of which a warning
        tells.  Raises InputError where nothing is left to show."""
        scenes = self.scenes
        if not any(scene.bones or scene.hood for scene in scenes):
            raise InputError(
                "there is nothing to show over time: the case cannot be built again here, and its "
                "hood has no shape"
            )
        if self.hood is None or all(scene.hood is not None for scene in scenes):
            return scenes
        warnings.warn(
            "the hood is not shown: its shape was stored at the end only (output.frames = 0)",
            stacklevel=3,
        )
        return tuple(replace(scene, hood=None) for scene in scenes)

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """The run at each of its stored states or times: of a motion as many as `output.frames`
        asks for.

        >>> import cosim
        >>> [frame.label for frame in cosim.run(cosim.load("pulley_edc")).frames]
        ['unloaded', 'loaded']

        Raises InputError where files of a run that was read cannot be."""
        shapes = self.scene.frames
        if not shapes and self.folder is not None:
            shapes = read_shapes(self.folder, self.arrays, self.hand)
        return frames_of(self.arrays, self.hood, shapes)

    @cached_property
    def scenes(self) -> tuple[Scene, ...]:
        """What there is to see in each of `frames`, m: hood, bones, tendons and the fingertip with
        its force.  Where the case cannot be built again here, as of a finger in an FMU, a warning
        says so and the hood stands alone."""
        try:
            return scenes_of(self.frames, self.arrays, self.checked_case())
        except InputError as error:
            warnings.warn(f"bones and tendons are not shown: {error}", stacklevel=3)
            return tuple(Scene(frame.hood, (), (), hand=self.hand) for frame in self.frames)

    def checked_case(self) -> Case:
        """The case that was run.  Raises InputError where it cannot be built again."""
        if self.folder is None:
            return case_of(self.case_table, self.case)
        return load_case(self.folder / "case.toml")

    @cached_property
    def _whole_scene(self) -> Scene:
        """What there is to see; of a run that was read with the finger, built again from its
        case."""
        if self.folder is None or self.scene.bones:
            return self.scene
        angles, force = (self.arrays.variables[name].values[-1] for name in ("angle", "tip_force"))
        end = Frame("", -1, None, angles, force, self.hood)
        try:
            return scenes_of([end], self.arrays, self.checked_case())[0]
        except InputError as error:
            warnings.warn(f"bones and tendons are not shown: {error}", stacklevel=3)
            return self.scene

    def picture(self, name: str) -> bytes | None:
        """PNG, a picture that the run left in its folder: "picture", "ledger" or "history"."""
        path = None if self.folder is None else self.folder / f"{name}.png"
        return path.read_bytes() if path is not None and path.is_file() else None

    def save(self, folder: str | Path) -> Path:
        """Write the run to `folder`/<case name> and return that path; a run that was read is copied
        as it was left.  A picture or table that cannot be made is a warning.

        Raises InputError where it cannot be written."""
        folder = path_from("folder", folder)
        if self.folder is not None:
            return copy_run(folder, self.case, self.folder)
        target, lacking = write_run(folder, self)
        for fault in lacking:
            warnings.warn(fault, stacklevel=2)
        return target

    def _repr_html_(self) -> str:
        """A notebook's view: the first numbers in tables, and the picture."""
        png = self.picture("picture")
        if png is None:
            png = as_png(self.plot(), 72)
        return html_of(self.title, self.summary, png)

    def __repr__(self) -> str:
        force = ", ".join(f"{axis} {value:.3g}" for axis, value in self.tip_force.items())
        return f"<Result of {self.case}: fingertip force {force} N; {self.audit}>"


def html_of(title: str, summary: Mapping[str, Any], png: bytes) -> str:
    """The title, the answer with its doubts and warnings, the tables of the terminal and the
    picture."""
    said = " ".join([*answer(summary), trust(summary)])
    parts = [f"<h4>{escape(title)}</h4><p>{escape(said)}</p>"]
    for doubt in (*doubts(summary), *summary.get("warnings", ())):
        parts.append(f"<p><b>▲ {escape(doubt)}</b></p>")
    for header, rows in rows_of(summary):
        parts.append(ReportTable("", "", header, rows).html(""))
    alt = escape(title, quote=True)
    return "\n".join(
        [*parts, f'<img alt="{alt}" src="{data_address(png)}" style="max-width:100%">']
    )
