"""Published experiments on lengths and cuts of the extensor beside the shell, the net of cables and
the network: rows of a verification, which are comparisons and never fail for a model that misses.

Nothing was fitted to them.  `cases/data/length_experiments.csv` says what was measured and how it
was read; each has its packaged case (`lengths_*`, `cuts_*`), whose assumptions stand there.  What a
lesion does is the difference between the case with it and without.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.resources import files
from typing import Any

from cosim.build_finger import skeleton_of
from cosim.case import load_case
from cosim.case_finger import IndexFinger
from cosim.case_schema import Case
from cosim.run import run_case
from cosim.verification import Row, Study

HOODS = {"shell": "", "net of cables": "base/cable", "network": "base/network"}
"""Case that states each hood; the shell is the experiments' own."""
LOADS = {"FDP 1 N": 'tendons.FDP.tension="1 N"', "FDP 3 N": 'tendons.FDP.tension="3 N"'}
"""Tones of the flexor against which EDC extends with the case's 5 N: assumptions."""
FLEXED = {"mcp": ("MCP", 60), "pip": ("PIP", 60), "dip": ("DIP", 45)}
"""Joint and deg of each experiment on glide."""
PIP_ANGLES = (0, 30, 60, 90)
"""deg, of the PIP in the experiment on the DIP's resistance."""
Summary = Mapping[str, Any]


@dataclass(frozen=True)
class Experiment:
    """What was measured, as printed: a mean, with its SD where it is known, or a bound from
    below."""

    name: str
    measured: str
    unit: str
    mean: float | None
    sd: float | None
    at_least: float | None
    n: int
    source: str
    read: str

    def row(self, model: str, computed: float) -> Row:
        """The experiment beside what a model, which is named, computes."""
        source = f"{self.source}; n {self.n}; {self.read}"
        quantity = f"{self.measured}, {self.unit}"
        if self.at_least is not None:
            more = max(computed - self.at_least, 0.0)
            text = f"{quantity}: at least"
            return Row(model, text, self.at_least, computed, more, source, "comparison")
        assert self.mean is not None  # it has no bound
        if self.sd is None:
            return Row(model, quantity, self.mean, computed, 0.0, source, "shown")
        return Row(model, quantity, self.mean, computed, self.sd, source, "comparison")


@cache
def experiments() -> Mapping[str, Experiment]:
    """The packaged experiments by name."""
    text = (files("cases") / "data" / "length_experiments.csv").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return {row["name"]: _experiment(row) for row in csv.DictReader(lines)}


def _experiment(row: Mapping[str, str]) -> Experiment:
    mean, sd, at_least = (float(row[c]) if row[c] else None for c in ("mean", "sd", "at_least"))
    name, measured, unit, source, read = (
        row[c] for c in ("name", "measured", "unit", "source", "read")
    )
    return Experiment(name, measured, unit, mean, sd, at_least, int(row["n"]), source, read)


def case_with(name: str, hood: str, settings: Sequence[str] = (), *, injured: bool = True) -> Case:
    """A packaged case with a hood of HOODS in place of its own, without its lesion if asked."""
    case = load_case(name, settings)
    if HOODS[hood]:
        case = case.model_copy(update={"hood": load_case(HOODS[hood]).hood})
    return case if injured else case.model_copy(update={"lesion": None})


def summary(name: str, hood: str, settings: Sequence[str] = (), *, injured: bool = True) -> Summary:
    """The summary of such a case's run."""
    return _summary(name, hood, tuple(settings), injured)


@cache
def _summary(name: str, hood: str, settings: tuple[str, ...], injured: bool) -> Summary:
    return run_case(case_with(name, hood, settings, injured=injured)).summary


def lengthened_rows(hood: str) -> Iterator[Row]:
    """How far the DIP drops with a longer terminal tendon, under either load."""
    for load, setting in LOADS.items():
        intact = summary("lengths_terminal_1mm", hood, [setting], injured=False)
        for name in ("terminal_1mm", "terminal_4mm"):
            longer = summary(f"lengths_{name}", hood, [setting])
            drop = longer["posture_deg"]["DIP"] - intact["posture_deg"]["DIP"]
            yield experiments()[name].row(f"{hood}, {load}", drop)


def gap_rows(hood: str) -> Iterator[Row]:
    """Posture of the finger whose central slip was mended with a gap, under either load."""
    for load, setting in LOADS.items():
        posture = summary("lengths_central_gap", hood, [setting])["posture_deg"]
        for joint in ("PIP", "DIP"):
            experiment = experiments()[f"central_gap_{joint.lower()}"]
            yield experiment.row(f"{hood}, {load}", posture[joint])


def cut_rows(hood: str) -> Iterator[Row]:
    """How much force of extension at the MCP is lost by either cut: torque of the hood over the
    distance to where it may have been measured."""
    for mcp in (0, 45):
        held = [f'finger.posture.MCP="{mcp} deg"']
        intact = _extension(summary("cuts_sagittal_bands", hood, held, injured=False))
        for cut, name in (("bands", "cuts_sagittal_bands"), ("tendon", "cuts_extensor_tendon")):
            lost = intact - _extension(summary(name, hood, held))
            for place, lever in levers(case_with(name, hood)).items():
                experiment = experiments()[f"{cut}_{mcp}"]
                yield experiment.row(f"{hood}, at the {place}", lost / lever)


def _extension(of: Summary) -> float:
    """N mm, with which the hood extends the MCP."""
    return -float(of["joint_torque_Nmm"]["hood"]["MCP"])


def levers(case: Case) -> dict[str, float]:
    """mm from the MCP to where its force may have been measured, of the straight finger."""
    assert isinstance(case.finger, IndexFinger)  # the packaged experiments are of one
    length = 1e3 * skeleton_of(case.finger).length
    return {"PIP": float(length[1]), "fingertip": float(length[1:].sum())}


def glide_rows(hood: str) -> Iterator[Row]:
    """How far the terminal slip moves, along the middle phalanx, as one joint flexes."""
    straight = summary("lengths_terminal_glide", hood)["glide_mm"]["terminal_slip"]
    for key, (joint, angle) in FLEXED.items():
        held = [f'finger.posture.{joint}="{angle} deg"']
        flexed = summary("lengths_terminal_glide", hood, held)["glide_mm"]["terminal_slip"]
        yield experiments()[f"glide_{key}"].row(hood, abs(flexed - straight))


def resistance_rows(hood: str) -> Iterator[Row]:
    """Where the hood at rest resists the flexed DIP most and least, and what of that a sheet loses
    with its oblique retinacular ligaments."""
    found = {}
    for angle in PIP_ANGLES:
        held = [f'finger.posture.PIP="{angle} deg"']
        found[angle] = _resistance(summary("lengths_dip_resistance", hood, held, injured=False))
    listed = ", ".join(f"{torque:.2g}" for torque in found.values())
    model = f"{hood} ({listed} N mm at PIP {', '.join(map(str, found))} deg)"
    yield experiments()["resistance_most"].row(model, max(found, key=lambda a: found[a]))
    yield experiments()["resistance_least"].row(model, min(found, key=lambda a: found[a]))
    if hood == "shell":
        cut = _resistance(summary("lengths_dip_resistance", hood, ['finger.posture.PIP="0 deg"']))
        yield experiments()["oblique_share"].row(hood, 100 * (1 - cut / found[0]))


def _resistance(of: Summary) -> float:
    """N mm, with which the hood at rest extends the DIP."""
    return -float(of["unloaded"]["joint_torque_Nmm"]["hood"]["DIP"])


Rows = Callable[[str], Iterator[Row]]
MADE: Mapping[str, tuple[Rows, tuple[str, ...]]] = {
    "terminal tendon longer": (lengthened_rows, tuple(HOODS)),
    "central slip mended with a gap": (gap_rows, tuple(HOODS)),
    "sagittal bands and tendon cut": (cut_rows, ("shell", "net of cables")),
    "glide of the terminal slip": (glide_rows, ("shell", "net of cables")),
    "resistance of the DIP": (resistance_rows, tuple(HOODS)),
}
"""By experiment, its rows and the hoods that have what it is about."""
STUDIES = tuple(
    Study(f"lengths and cuts: {what}, {hood}", partial(rows, hood), slow=True)
    for what, (rows, hoods) in MADE.items()
    for hood in hoods
)
