"""The page of the collection of measurements: what there is, each source, and what nobody
measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from cosim.files import write_text
from cosim.measured import (
    JOINTS,
    QUANTITIES,
    RANGE,
    Evidence,
    Measured,
    Source,
    all_measured,
    not_measured,
    read_measured,
    sources,
)
from cosim.report.templates import html_page
from cosim.results.compare import number
from cosim.results.table import ReportTable

EVIDENCE: Mapping[Evidence, tuple[str, str]] = {
    "experiment": ("●", "of experiments whose own text, figures or data were read"),
    "experiment at second hand": (
        "◐",
        "of experiments known by an abstract or a quotation alone",
    ),
    "inferred": ("◇", "worked out from what was measured"),
    "published model": ("△", "of published models, not measured"),
}
"""A shape for each, the strongest first, and what it means."""
MUSCLES = ("FDP", "FDS", "EDC", "EI", "EDM", "FDI", "FPI", "LUM", "RI", "UI", "ADM")
"""Columns of the tables by muscle; others follow."""
WORDS = {
    **{"MCP_abduction": "MCP, sideways", "min": "least", "max": "largest", "": "not said"},
    **{"both": "either slip", "size": "its size"},
}
"""Names of parts that are no words."""
FINGERS = ("index", "middle", "ring", "little", "several", "")
STATES = {
    "not measured": "nobody measured it, as far as was seen",
    "not printed": "measured, but the number is not in print",
    "not read": "in print, in a text that was not at hand",
    "in conflict": "texts contradict each other",
}


def write_measured_page(path: Path) -> None:
    """The page of the collection.  Raises InputError where it is at fault, or the file cannot be
    written."""
    every = all_measured()
    lacking = [list(gap.model_dump().values()) for gap in not_measured()]
    page = html_page(
        "measured.html.j2",
        numbers=len(every),
        evidence=[(*EVIDENCE[e], n) for e, n in _counts(every).items()],
        tables=tuple(_tables(every)),
        choices=_choices(every),
        rows=[_row(m) for m in every],
        sources=ReportTable("sources", "Sources", *_source_table()),
        lacking=ReportTable("lacking", "What nobody measured", GAPS, lacking),
        states=STATES,
    )
    write_text(path, page)


GAPS = ("Quantity", "Of", "State", "What is known", "What our models take", "What would measure it")
"""Columns of the table of `NotMeasured`, by its fields."""


def source_rows() -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """A header, and a line for each source: what, how many numbers, n, fingers, fixture, how read,
    licence."""
    _, lines = _source_table()
    return ("source", "what", "numbers", "n", "finger", "held by", "read", "licence"), [
        (source.source, line[1], line[2].split()[-1], *line[3:7], source.licence or "–")
        for source, line in zip(sources().values(), lines, strict=True)
    ]


def _source_table() -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and rows of all sources: who, what, the numbers with their evidence, and how."""
    head = ("Source", "What was measured", "Numbers", "n", "Finger", "Held by", "How read")
    return (*head, "What was seen of it", "Licence"), [*map(_source, sources().values())]


def quantity_words(m: Measured) -> str:
    """What a number is of, in words."""
    known = QUANTITIES.get(m.kind)
    name = known.words.partition(":")[0] if known else m.kind.replace("_", " ")
    parts = [
        f"as {part} flexes" if what == "joints" else WORDS.get(part, part.replace("_", " "))
        for what, part in m.of.items()
    ]
    return f"{name}: {', '.join(parts)}" if parts else name


def value_words(m: Measured) -> str:
    """The value with its SD and bounds."""
    parts = [number(m.value)] if m.value is not None else []
    if m.sd is not None:
        parts.append(f"± {number(m.sd)}")
    if m.low is not None and m.high is not None:
        ends = f"{number(m.low)} to {number(m.high)}"
        parts.append(f"({ends})" if parts else ends)
    elif m.low is not None:
        parts.append(f"at least {number(m.low)}" if m.low else "more than 0")
    elif m.high is not None:
        parts.append(f"at most {number(m.high)}")
    return " ".join(parts)


def _counts(rows: Iterable[Measured]) -> dict[Evidence, int]:
    count = Counter(m.evidence for m in rows)
    return {e: count[e] for e in EVIDENCE if count[e]}


def _cell(rows: Sequence[Measured]) -> str:
    """Shape of the strongest evidence with the count, over which a pointer shows who says it."""
    if not rows:
        return ""
    shape, _ = EVIDENCE[next(iter(_counts(rows)))]
    cited = dict.fromkeys(m.cited.cited for m in rows)
    return Markup('<span title="{}">{} {}</span>').format("; ".join(cited), shape, len(rows))


def _order(m: Measured) -> tuple[int, tuple[float, ...]]:
    """For an order of lines: known kinds first, in the order of their table, then by posture."""
    kinds = list(QUANTITIES)
    return kinds.index(m.kind) if m.kind in kinds else len(kinds), m.angles or ()


def _kind_words(m: Measured) -> str:
    known = QUANTITIES.get(m.kind)
    name = known.words.partition(":")[0] if known else m.kind.replace("_", " ")
    return name if m.unit == "1" else f"{name}, {m.unit}"


def _matrix(
    title: str,
    first: str,
    rows: Iterable[Measured],
    columns: Sequence[str],
    column_of: Callable[[Measured], str],
    line_of: Callable[[Measured], str] = _kind_words,
) -> ReportTable:
    lines: dict[str, list[Measured]] = {}
    for m in rows:
        lines.setdefault(line_of(m), []).append(m)
    cells = [
        (line, *(_cell([m for m in of_line if column_of(m) == c]) for c in columns))
        for line, of_line in lines.items()
    ]
    return ReportTable("", title, (first, *(WORDS.get(c, c) for c in columns)), cells)


def _tables(every: Sequence[Measured]) -> Iterator[ReportTable]:
    """Counts by quantity and muscle, by quantity and joint, of clamped fingertips by posture and
    muscle, and of all else by finger."""
    every = sorted(every, key=_order)
    of_muscles = [m for m in every if m.muscle]
    muscles = list(dict.fromkeys([*MUSCLES, *(m.muscle for m in of_muscles)]))
    yield _matrix("By quantity and muscle", "Quantity", of_muscles, muscles, _muscle)
    of_joints = [m for m in every if m.joint]
    joints = [j for j in JOINTS if any(m.joint == j for m in of_joints)]
    yield _matrix("By quantity and joint", "Quantity", of_joints, joints, lambda m: m.joint)
    clamped = [m for m in of_muscles if "clamped" in m.fixture]
    clamped.sort(key=lambda m: (not m.posture, m.angles or ()))
    muscles = [name for name in muscles if any(m.muscle == name for m in clamped)]
    title, first = "Clamped fingertips, by posture and muscle", "MCP/PIP/DIP, deg"
    yield _matrix(title, first, clamped, muscles, _muscle, lambda m: m.posture or "not known")
    others = [m for m in every if not m.muscle and not m.joint]
    fingers = [f for f in FINGERS if any(m.finger == f for m in others)]
    title = "Hood, bands and bones, by finger"
    yield _matrix(title, "Quantity", others, fingers, lambda m: m.finger, quantity_words)


def _muscle(m: Measured) -> str:
    return m.muscle


def _choices(every: Sequence[Measured]) -> dict[str, list[str]]:
    """What one may choose rows by."""
    return {
        "quantity": sorted({_kind_words(m) for m in every}),
        "muscle": list(dict.fromkeys(m.muscle for m in every if m.muscle)),
        "joint": [j for j in JOINTS if any(m.joint == j for m in every)],
        "finger": list(dict.fromkeys(m.finger for m in every if m.finger)),
        "evidence": [e for e in EVIDENCE if any(m.evidence == e for m in every)],
        "source": [s.cited for s in sources().values()],
    }


def _row(m: Measured) -> dict[str, Any]:
    posture = "mean over the flexion" if m.posture == RANGE else m.posture
    return {
        "words": quantity_words(m),
        "value": value_words(m),
        "unit": "" if m.unit == "1" else m.unit,
        "shape": EVIDENCE[m.evidence][0],
        "n": "–" if m.n is None else str(m.n),
        "hand": m.hand,
        "posture": posture,
        "circumstances": "; ".join(filter(None, (m.frame, m.fixture, m.load))),
        "read": "; ".join(filter(None, (m.read, m.note))),
        "address": m.address,
        "m": m,
        "kind": _kind_words(m),
    }


def _source(source: Source) -> tuple[str, ...]:
    rows = read_measured(source.source)
    link = f"https://doi.org/{source.doi}" if source.doi else source.url
    cited = Markup('<a href="{}">{}</a>').format(link, source.cited) if link else source.cited
    shapes = " ".join(EVIDENCE[e][0] for e in _counts(rows))
    return (
        *(cited, source.what, f"{shapes} {len(rows)}"),
        _listed(str(n) for n in sorted({m.n for m in rows if m.n})),
        *(_listed(m.finger for m in rows), _listed(m.fixture for m in rows)),
        _listed(m.read.partition(":")[0].partition(";")[0] for m in rows),
        *(source.seen, source.licence or "none stated"),
    )


def _listed(words: Iterable[str]) -> str:
    return ", ".join(dict.fromkeys(filter(None, words))) or "not said"
