"""How far a run's fibres are strained, region by region, and whether tendons tear at that.

The 95th percentile over a region's area stands for the region: extremes of single quads grow as a
mesh gets finer.  Fibres with a toe bear nothing to speak of before they are straight, so what may
tear them is their strain beyond that.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

TEARS = 10.0
"""%, strain of straight fibres from which on tendons tear when they are tested: some 10 to 15 %, an
order of size and no measurement of a hood, whose tissue tears at larger strains than tendons
(Qian et al. 2014, abstract; their numbers were not read)."""
Summary = Mapping[str, Any]


class FibreStrain(NamedTuple):
    """A region's strain along its fibres, and beyond the strain at which they are straight, %."""

    region: str
    strain: float
    beyond: float

    @property
    def words(self) -> str:
        """The strain with its region, and what the fibres do there."""
        text = f"{self.strain:.2f} % in the {self.region.replace('_', ' ')}"
        if self.beyond < 0 < self.strain:
            return f"{text}, whose fibres are not straight yet"
        if self.beyond < self.strain - 1.5:
            text = f"{text}, {self.beyond:.2f} % beyond straight"
        return f"{text}, at which tendons tear" if self.beyond > TEARS else text


def fibre_strains(summary: Summary) -> list[FibreStrain]:
    """The regions of a sheet, the most strained first; none of another hood."""
    found = summary.get("fibre_strain_percent", {}).items()
    pairs = ((name, strain.get("p95"), strain.get("beyond_straight")) for name, strain in found)
    return sorted((FibreStrain(*p) for p in pairs if None not in p), key=lambda s: -s.strain)


def largest_strain(summary: Summary) -> str:
    """Say where the fibres are strained most, and most beyond straight; empty without a sheet."""
    each = fibre_strains(summary)
    if not each:
        return ""
    most, taut = each[0], max(each, key=lambda s: s.beyond)
    more = "" if taut is most else f"; of straight fibres, {taut.words}"
    return f"Largest strain along the fibres (95th percentile of a region): {most.words}{more}."


def torn(summary: Summary) -> Iterator[str]:
    """Say in which regions the strain is one at which tendons tear."""
    overloaded = [s for s in fibre_strains(summary) if s.beyond > TEARS]
    if overloaded:
        where = ", ".join(f"{s.region.replace('_', ' ')} ({s.beyond:.0f} %)" for s in overloaded)
        yield (
            f"Strained by more than {TEARS:.0f} % beyond straight: {where}. Tendons tear at some "
            "10 to 15 %; in the model nothing tears."
        )
