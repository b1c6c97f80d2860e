"""Paper 003's air, computed anew: figures 6 and 7, and what their likeness depends on.

Xu et al. 2012, Design of an anthropomorphic robotic finger system with biomimetic artificial
joints, sections III and IV."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.port import Array
from cosim.report.figures import Figure, FigureStudy, style_axes
from rigid.air.model import (
    AMPLITUDE,
    AT,
    FULL_TERMS,
    SAMPLE,
    STEPPED_DOWN,
    STEPPED_UP,
    TERM_NAMES,
    TRAINING,
    UNSEEN,
    Identification,
    PressureRecord,
    identification,
    identify,
    latency,
    pair_rows,
    r_squared,
    steps,
)
from rigid.air.plant import Pneumatics, Valve

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

KPA = 1e-3
PLANT, MODEL, WITHOUT = "#0b5394", "#b45309", "0.55"
SHOWN = 4.0
"""s of each record that are drawn, its last."""
PLANT_IS = (
    "The plant is ours, from first principles (ISO 6358 valve, chamber with heat from its walls, "
    "90 psi, 100 Hz): bore, rod, tube and valve are assumed, since the paper names the parts and "
    "not their data, and its dead time of 30 ms is fitted to the paper's latency of 50 ms."
)


@lru_cache(maxsize=1)
def shown_identification() -> Identification:
    """The identification that the figures show."""
    return identification(Pneumatics())


def model_figures() -> list[Figure]:
    """Figure 6."""
    found = shown_identification()
    still = identify(found.training, 0)
    whole, each = r_squared(found.model, found.unseen)
    without = r_squared(still, found.unseen)[0]
    heard = ", ".join(f"{f:g}" for f in TRAINING)
    caption = (
        f"dP/dt at frequencies that the model has not seen (identified from sines of {heard} Hz "
        f"and {AMPLITUDE:g} V about 5 V). R2 {whole:.3f} together, "
        + ", ".join(f"{r2:.3f} at {f:g} Hz" for f, r2 in zip(UNSEEN, each, strict=True))
        + f"; the paper says above 0.9. The voltage is that of {found.model.lag} samples before, "
        f"identified too: the equation as printed has no dead time, and without it R2 is "
        f"{without:.2f}. {PLANT_IS} Frequencies and amplitude are ours; the paper prints none."
    )
    courses = {
        f: _course(found.unseen, found.model.lag, found.model.rate, still.rate, k)
        for k, f in enumerate(UNSEEN)
    }
    tables = {
        "figure_6_flow_rate": pd.concat(
            [data.assign(frequency_Hz=f) for f, data in courses.items()], ignore_index=True
        ),
        "figure_6_coefficients": _coefficients(found),
    }
    title = "Figure 6: flow rate of the plant and of the polynomial model"
    return [
        Figure(
            "figure_6_flow_rate", title, caption, lambda s: _draw_rates(s, courses), tables, (7, 7)
        )
    ]


Rate = Callable[[Array, Array], Array]
UNIT = "dPdt_kPa_per_s"


def _course(record: PressureRecord, lag: int, model: Rate, still: Rate, k: int) -> pd.DataFrame:
    """The course of one cylinder: dP/dt of the plant and of both models, from the longer of their
    lags on."""
    voltage, pressure, rate = (a[:, k] for a in pair_rows(record, lag))
    now = pair_rows(record, 0)[0][-len(rate) :, k]
    time = record.time[-1 - len(rate) : -1]
    return pd.DataFrame(
        {
            "time_s": time,
            f"plant_{UNIT}": KPA * rate,
            f"model_{UNIT}": KPA * model(pressure, voltage),
            f"model_without_delay_{UNIT}": KPA * still(pressure, now),
        }
    )


def _draw_rates(sheet: Sheet, courses: dict[float, pd.DataFrame]) -> None:
    rows = sheet.subplots(len(courses), 1)
    for axes, (frequency, data) in zip(rows, courses.items(), strict=True):
        last = min(SHOWN, 6.0 / frequency)
        part = data[data.time_s > data.time_s.iloc[-1] - last]
        for kind, colour, dash, width, name in (
            ("plant", PLANT, "-", 2.2, "plant"),
            ("model", MODEL, "--", 1.6, "model"),
            ("model_without_delay", WITHOUT, ":", 1.4, "model without delay"),
        ):
            axes.plot(part.time_s, part[f"{kind}_{UNIT}"], dash, color=colour, lw=width, label=name)
        style_axes(axes, "", f"{frequency:g} Hz\nkPa/s")
    rows[-1].set_xlabel("time, s")
    handles, names = rows[0].get_legend_handles_labels()
    sheet.legend(handles, names, loc="outside lower center", ncols=3, frameon=False)


def _coefficients(found: Identification) -> pd.DataFrame:
    """The coefficients of the printed equation, P in Pa above the atmosphere and V in V."""
    m = found.model
    return pd.DataFrame(
        {
            "coefficient": [TERM_NAMES[term] for term in m.terms],
            "value_SI_and_V": m.coefficients,
            "half_of_95_percent_interval": m.interval,
        }
    )


def step_figures() -> list[Figure]:
    """Figure 7."""
    air = Pneumatics()
    sides = {
        "from an empty chamber (0 V)": steps(air, 0.0, STEPPED_UP, 0.4),
        "from a full chamber (10 V)": steps(air, 10.0, STEPPED_DOWN, 0.4),
    }
    ends = dict(zip(sides, (STEPPED_UP, STEPPED_DOWN), strict=True))
    found = np.concatenate([latency(record) for record in sides.values()])
    caption = (
        f"dP/dt after steps of the voltage from an extreme; pistons fixed. The largest effect "
        f"comes {1e3 * np.median(found):.0f} ms after the step (from {1e3 * found.min():.0f} to "
        f"{1e3 * found.max():.0f}, to the 10 ms of the samples); the paper says about 50. That "
        "is a fit and no prediction: the plant's dead time was sized to it; spool, average and "
        f"difference make the rest. {PLANT_IS}"
    )
    tables = {
        "figure_7_steps": pd.concat(
            [_step_table(name, record, ends[name]) for name, record in sides.items()],
            ignore_index=True,
        )
    }
    return [
        Figure(
            "figure_7_steps",
            "Figure 7: flow rate after steps of the voltage",
            caption,
            lambda sheet: _draw_steps(sheet, sides, ends),
            tables,
            (7.5, 6.5),
        )
    ]


def _step_table(name: str, record: PressureRecord, ends: tuple[float, ...]) -> pd.DataFrame:
    late = 1e3 * latency(record)
    parts = [
        pd.DataFrame(
            {
                "steps": name,
                "to_V": end,
                "latency_ms": late[k],
                "since_step_ms": 1e3 * (record.time[1:-1] - AT),
                UNIT: KPA * record.rate[:, k],
            }
        )
        for k, end in enumerate(ends)
    ]
    return pd.concat(parts, ignore_index=True)


def _draw_steps(
    sheet: Sheet, sides: dict[str, PressureRecord], ends: dict[str, tuple[float, ...]]
) -> None:
    from matplotlib import colormaps

    for axes, (name, record) in zip(sheet.subplots(2, 1, sharex=True), sides.items(), strict=True):
        since = 1e3 * (record.time[1:-1] - AT)
        shades = colormaps["viridis"](np.linspace(0.0, 0.85, len(ends[name])))
        for rate, end, shade in zip(record.rate.T, ends[name], shades, strict=True):
            axes.plot(since, 1e-6 * rate, ".-", color=shade, lw=1.4, ms=3.5, label=f"to {end:g} V")
        axes.axvline(50.0, color="0.4", lw=1.0, ls="--")
        style_axes(axes, "", "dP/dt, MPa/s")
        axes.set_title(name, fontsize=10, loc="left")
        axes.set_xlim(-20.0, 300.0)
        axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.set_xlabel("since the step, ms (dashed: the paper's 50 ms)")


SPREADS = (1.0, 2.0, 4.0)
"""V, amplitudes beyond the underlap."""


def doubt_figures() -> list[Figure]:
    """What R2 depends on."""
    plain = Pneumatics()
    variants = {
        f"as figure 6: {AMPLITUDE:g} V": shown_identification(),
        **{f"{a:g} V": identification(plain, a) for a in SPREADS},
        "underlap 0.05": identification(Pneumatics(Valve(underlap=0.05))),
        "underlap 0.2": identification(Pneumatics(Valve(underlap=0.2))),
        "no delay in plant": identification(Pneumatics(Valve(delay=0.0))),
    }
    data = pd.DataFrame([{"variant": name, **_scores(v)} for name, v in variants.items()])
    caption = (
        "R2 of dP/dt at the unseen frequencies: with the delay identified in whole samples, with "
        "none, and with the term a1 V that the printed equation lacks. Of what was assumed the "
        "amplitude and the underlap matter most: beyond the underlap the valve no longer sets a "
        "pressure, the chamber is full or empty most of the time, and fills within a few samples. "
        f"The delay matters more than all of it. {PLANT_IS}"
    )
    return [
        Figure(
            "figure_6_doubts",
            "Figure 6, in doubt: what the share explained depends on",
            caption,
            lambda sheet: _draw_scores(sheet, data),
            {"figure_6_doubts": data},
            (7.0, 4.2),
        )
    ]


def _scores(found: Identification) -> dict[str, float]:
    whole, each = r_squared(found.model, found.unseen)
    return {
        "R2": whole,
        "R2_of_the_worst_frequency": float(each.min()),
        "R2_without_delay": r_squared(identify(found.training, 0), found.unseen)[0],
        "R2_with_a1": r_squared(identify(found.training, None, FULL_TERMS), found.unseen)[0],
        "delay_identified_ms": 1e3 * SAMPLE * found.model.lag,
    }


def _draw_scores(sheet: Sheet, data: pd.DataFrame) -> None:
    axes = sheet.subplots()
    at = np.arange(len(data))[::-1]
    for column, mark, colour, name in (
        ("R2", "o", PLANT, "printed equation, delay identified"),
        ("R2_of_the_worst_frequency", "|", PLANT, "its worst frequency"),
        ("R2_with_a1", "D", MODEL, "with a1 V"),
        ("R2_without_delay", "s", WITHOUT, "printed equation, no delay"),
    ):
        axes.plot(data[column], at, mark, color=colour, ms=7, label=name)
    axes.axvline(0.9, color="0.4", lw=1.0, ls="--")
    style_axes(axes, "R2 at unseen frequencies (dashed: the paper's 0.9)", "")
    axes.set_yticks(at, data["variant"])
    sheet.legend(loc="outside lower center", ncols=2, frameon=False)


STUDIES: tuple[FigureStudy, ...] = (
    FigureStudy("air", "figure 6: the polynomial model of the air on unseen data", model_figures),
    FigureStudy("latency", "figure 7: flow rate after steps of the voltage", step_figures),
    FigureStudy("air-doubts", "what the model's R2 depends on", doubt_figures),
)
