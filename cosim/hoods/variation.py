"""An assumption of a case at a lower and a higher value: pairs of settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from cosim.schema import units
from cosim.schema.units import Kind

Settings = tuple[str, ...]


@dataclass(frozen=True)
class Side:
    """One end of a variation: what is set, in short, and the settings; or why there is no such
    end."""

    label: str
    settings: Settings = ()
    why_not: str = ""


@dataclass(frozen=True)
class Variation:
    """Something that the case assumes, at a lower and a higher value."""

    name: str
    low: Side
    high: Side


def scale(
    name: str, values: Mapping[str, float | None], factors: tuple[float, float], kind: Kind | None
) -> Variation:
    """All values that there are by the same factor."""

    def side(factor: float) -> Side:
        stated = ((key, value) for key, value in values.items() if value is not None)
        return Side(f"x {factor:g}", settings_text(((k, factor * v) for k, v in stated), kind))

    return Variation(name, side(factors[0]), side(factors[1]))


def shift(
    name: str,
    values: Mapping[str, float],
    step: float,
    kind: Kind | None,
    least: float = float("-inf"),
) -> Variation:
    """All values less and more the same step, but none below `least`."""

    def side(sign: int) -> Side:
        new = {key: max(value + sign * step, least) for key, value in values.items()}
        moved = max((new[key] - values[key] for key in values), key=abs)
        if not moved:
            return Side(
                "", why_not=f"it is {format_value(least, kind)} as it is, which is the least"
            )
        return Side(
            f"{'+' if sign > 0 else '-'}{format_value(abs(moved), kind)}",
            settings_text(new.items(), kind),
        )

    return Variation(name, side(-1), side(1))


def settings_text(values: Iterable[tuple[str, float]], kind: Kind | None) -> Settings:
    """Settings KEY=VALUE of SI values, each in the kind's own unit; plain numbers for no kind."""
    return tuple(f"{k}={v!r}" if kind is None else f"{k}={format_si(v, kind)}" for k, v in values)


def format_value(value: float, kind: Kind | None) -> str:
    """An SI value in the kind's own unit to four digits; a plain number without a kind."""
    return f"{value:.4g}" if kind is None else format_si(value, kind, 4)


def format_si(value: float, kind: Kind, digits: int = 10) -> str:
    """An SI value in the kind's own unit."""
    return f"{value / units.parse(f'1 {kind.unit}', kind):.{digits}g} {kind.unit}"


def no_variation(name: str, reason: str) -> Variation:
    """A variation that has neither end, with the reason."""
    return Variation(name, Side("", why_not=reason), Side("", why_not=reason))


def words(key: str) -> str:
    """A key of a case file with spaces."""
    return key.replace("_", " ")
