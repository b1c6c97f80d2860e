"""Published experiments on lengths and cuts of the extensor, repeated with hoods of growing detail.

Nothing was fitted to them.  `cases/data/length_experiments.csv` names the measured numbers, which
the collection has, and what is assumed of them; each has its packaged case (`lengths_*`, `cuts_*`),
whose assumptions stand there.  What a lesion does is the difference between the case with it and
without.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.fingers.kinds import skeleton_of
from cosim.measured import measured_at
from cosim.pipeline import run_case
from cosim.text_tables import CsvRow, packaged_rows

HOODS = {"shell": "", "net of cables": "base/cable", "network": "base/network"}
"""Case that states each hood; the shell is the experiments' own."""
LOADS = {"tone": 1.0, "stronger flexors": 1.5}
"""Loads of the lags: the tone of all muscles that `base/lesion.toml` states, its flexors so many
times as strong.  Assumptions, under which the intact finger is straight to 5 deg."""
FLEXORS = ("FDP", "FDS")
LAG = "lengths_terminal_1mm"
"""A case of the finger whose lags are measured; intact they are one."""
FLEXED = {"mcp": ("MCP", 60), "pip": ("PIP", 60), "dip": ("DIP", 45)}
"""Joint and deg of each experiment on glide."""
PIP_ANGLES = (0, 30, 60, 90)
"""deg, of the PIP in the experiment on the DIP's resistance."""
Summary = Mapping[str, Any]


@dataclass(frozen=True)
class Experiment:
    """What was measured, as printed: a mean, with its SD where it is known or a tolerance is
    assumed, or a bound from below."""

    name: str
    measured: str
    unit: str
    mean: float | None
    sd: float | None
    at_least: float | None
    n: int | None
    source: str
    read: str


class Value(NamedTuple):
    """What a model computes for an experiment, under which assumption, and what else it shows."""

    experiment: str
    where: str
    value: float
    shown: str = ""


@cache
def experiments() -> Mapping[str, Experiment]:
    """The packaged experiments by name."""
    return {row.cells["name"]: _experiment(row) for row in packaged_rows("length_experiments")}


def _experiment(row: CsvRow) -> Experiment:
    name, what, address, assumed = (row.cells[c] for c in ("name", "what", "measured", "assumed"))
    sd, at_least = row.number("sd"), row.number("at_least")
    m = measured_at(address)
    return Experiment(
        *(name, what, m.unit, m.value),
        m.sd if sd is None else sd,
        m.low if at_least is None else at_least,
        *(m.n, m.cited.text, "; ".join(filter(None, (m.read, assumed)))),
    )


def case_with(name: str, hood: str, settings: Sequence[str] = (), *, injured: bool = True) -> Case:
    """A packaged case with a hood of HOODS in place of its own, without its lesion if asked."""
    case = load_case(name, settings)
    if HOODS[hood]:
        case = _hand_over(case.model_copy(update={"hood": load_case(HOODS[hood]).hood}))
    return case if injured else case.without_lesion()


def _hand_over(case: Case) -> Case:
    """The case with EI's tension on EDC where its hood has no EI."""
    tendons = dict(case.tendons)
    if "EI" in case.hood.tendon_names("index") or tendons["EI"].tension is None:
        return case
    both = (tendons["EDC"].tension or 0.0) + (tendons.pop("EI").tension or 0.0)
    tendons["EDC"] = tendons["EDC"].model_copy(update={"tension": both})
    return case.model_copy(update={"tendons": tendons})


def summary(name: str, hood: str, settings: Sequence[str] = (), *, injured: bool = True) -> Summary:
    """The summary of such a case's run."""
    return _summary(name, hood, tuple(settings), injured)


@cache
def _summary(name: str, hood: str, settings: tuple[str, ...], injured: bool) -> Summary:
    return run_case(case_with(name, hood, settings, injured=injured)).summary


def dip_drop(hood: str, settings: Sequence[str] = ()) -> Iterator[Value]:
    """How far the DIP drops with a longer terminal tendon, under either load."""
    for load in LOADS:
        for name in ("terminal_1mm", "terminal_4mm"):
            yield Value(name, load, lag(name, hood, settings, load)["DIP"])


def posture_after_repair(hood: str, settings: Sequence[str] = ()) -> Iterator[Value]:
    """How far the finger whose central slip was mended with a gap leaves the straight intact one,
    under either load."""
    for load in LOADS:
        turned = lag("central_gap", hood, settings, load)
        for joint in ("PIP", "DIP"):
            yield Value(f"central_gap_{joint.lower()}", load, turned[joint])


def lag(name: str, hood: str, settings: Sequence[str], load: str) -> dict[str, float]:
    """How far (deg) each joint flexes by the lesion of `lengths_NAME`, under a load of LOADS."""
    asked = [*settings, *_tone(LOADS[load])]
    intact = summary(LAG, hood, asked, injured=False)["posture_deg"]
    longer = summary(f"lengths_{name}", hood, asked)["posture_deg"]
    return {joint: longer[joint] - intact[joint] for joint in longer}


def _tone(times: float) -> list[str]:
    """Settings of the flexors' tensions, times so much."""
    stated = {name: load_case(LAG).tension(name) for name in FLEXORS}
    return [f'tendons.{name}.tension="{times * tension:.9g} N"' for name, tension in stated.items()]


def cut(hood: str, settings: Sequence[str] = ()) -> Iterator[Value]:
    """How much force of extension at the MCP is lost by either cut: torque of the hood over the
    distance to where it may have been measured."""
    for mcp in (0, 45):
        held = [*settings, f'finger.posture.MCP="{mcp} deg"']
        intact = _extension(summary("cuts_sagittal_bands", hood, held, injured=False))
        for what, name in (("bands", "cuts_sagittal_bands"), ("tendon", "cuts_extensor_tendon")):
            lost = intact - _extension(summary(name, hood, held))
            for place, lever in levers(case_with(name, hood)).items():
                yield Value(f"{what}_{mcp}", f"at the {place}", lost / lever)


def _extension(of: Summary) -> float:
    """The torque (N mm) with which the hood extends the MCP."""
    return -float(of["joint_torque_Nmm"]["hood"]["MCP"])


def levers(case: Case) -> dict[str, float]:
    """The distance (mm) from the MCP to where its force may have been measured, of the straight
    finger."""
    length = 1e3 * skeleton_of(case.native_finger()).length
    return {"PIP": float(length[1]), "fingertip": float(length[1:].sum())}


def glide(hood: str, settings: Sequence[str] = ()) -> Iterator[Value]:
    """How far the terminal slip moves, along the middle phalanx, as one joint flexes."""

    def place(*held: str) -> float:
        moved = summary("lengths_terminal_glide", hood, [*settings, *held])["glide_mm"]
        return float(moved["terminal_slip"])

    straight = place()
    for key, (joint, angle) in FLEXED.items():
        flexed = place(f'finger.posture.{joint}="{angle} deg"')
        yield Value(f"glide_{key}", "", abs(flexed - straight))


def resistance(hood: str, settings: Sequence[str] = ()) -> Iterator[Value]:
    """Where the hood at rest resists the flexed DIP most and least, and what of that a sheet loses
    with its oblique retinacular ligaments."""

    def torque(pip: int, *, injured: bool) -> float:
        held = [*settings, f'finger.posture.PIP="{pip} deg"']
        return _resistance(summary("lengths_dip_resistance", hood, held, injured=injured))

    torques = {angle: torque(angle, injured=False) for angle in PIP_ANGLES}
    listed = ", ".join(f"{each:.2g}" for each in torques.values())
    shown = f" ({listed} N mm at PIP {', '.join(map(str, torques))} deg)"
    yield Value("resistance_most", "", max(torques, key=lambda a: torques[a]), shown)
    yield Value("resistance_least", "", min(torques, key=lambda a: torques[a]), shown)
    if hood == "shell":
        yield Value("oblique_share", "", 100 * (1 - torque(0, injured=True) / torques[0]))


def _resistance(of: Summary) -> float:
    """The torque (N mm) with which the hood at rest extends the DIP."""
    return -float(of["unloaded"]["joint_torque_Nmm"]["hood"]["DIP"])


class ExperimentModel(NamedTuple):
    """How experiments are repeated: what makes their values, on which hoods beside the shell, the
    experiments, what is assumed of each (the first is judged), and a case of theirs."""

    values: Callable[[str, Sequence[str]], Iterator[Value]]
    hoods: tuple[str, ...]
    experiments: tuple[str, ...]
    assumptions: tuple[str, ...]
    case: str


LUMPED = ("net of cables", "network")
EXPERIMENT_MODELS: Mapping[str, ExperimentModel] = {
    "terminal tendon longer": ExperimentModel(
        dip_drop, LUMPED, ("terminal_1mm", "terminal_4mm"), tuple(LOADS), "lengths_terminal_1mm"
    ),
    "central slip mended with a gap": ExperimentModel(
        posture_after_repair,
        LUMPED,
        ("central_gap_pip", "central_gap_dip"),
        tuple(LOADS),
        "lengths_central_gap",
    ),
    "sagittal bands and tendon cut": ExperimentModel(
        cut,
        LUMPED[:1],
        ("bands_0", "bands_45", "tendon_0", "tendon_45"),
        ("at the PIP", "at the fingertip"),
        "cuts_sagittal_bands",
    ),
    "glide of the terminal slip": ExperimentModel(
        glide, LUMPED[:1], ("glide_mcp", "glide_pip", "glide_dip"), ("",), "lengths_terminal_glide"
    ),
    "resistance of the DIP": ExperimentModel(
        resistance,
        LUMPED,
        ("resistance_most", "resistance_least", "oblique_share"),
        ("",),
        "lengths_dip_resistance",
    ),
}
"""The experiments by name."""
