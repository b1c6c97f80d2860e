"""A model to judge, as a case: a case of ours as it is, a MuJoCo or OpenSim model read into one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from cosim.analyses.mjcf_hood import attached_hood
from cosim.anatomy.case_folder import new_case
from cosim.anatomy.read import UserAnatomy
from cosim.case.file import load_case
from cosim.case.schema import Case, CouplingConfig
from cosim.errors import InputError
from cosim.files import shown_path
from cosim.fingers.kinds import native_tendons
from cosim.models.build import build
from cosim.scoring.names import FINGERS, TIP, FingerName, Matched, match_names
from cosim.tendons.table import TendonConfig
from cosim.text_tables import read_toml, toml_text
from meshes.skeleton import JOINTS
from rigid.mjcf.frames import UlnarAbductionError, first_names
from rigid.mjcf.read import PartNames, part_names
from rigid.opensim.losses import report
from rigid.opensim.osim import Imported, import_osim, write_import
from rigid.opensim.osim import part_names as osim_part_names

Source = Literal["case", "MuJoCo", "OpenSim"]
ASSUMED_TIP = 22.6 / 22.8
"""The distal phalanx over the middle one, of a model that names no fingertip: means of the hands of
Qiu et al. 2017 (`cases/data/measured/qiu2017.csv`)."""
OF_OTHERS = re.compile(
    "pulls on no phalanx|which moves|other joints|sensors|keyframes|contacts of|gravity"
    "|the frame of|were not asked for|only say how|curves and dynamics|no tendon of a case"
    "|phalanges "
)
"""What of an import's losses has nothing to do with the arms and lengths of the finger."""


@dataclass(frozen=True)
class HandModel:
    """A model to judge."""

    name: str
    source: Source
    finger: FingerName
    case: Case
    tendons: tuple[str, ...]
    """The muscles that it has, by our names."""
    lost: tuple[str, ...] = ()
    """What its import lost, changed and assumed."""
    matched: Matched | None = None
    """The names of its parts; None of a case of ours."""
    strengths: Mapping[str, float] = field(default_factory=dict)
    """The greatest force (N) of each muscle for which the model states one."""
    fibres: Mapping[str, float] = field(default_factory=dict)
    """The optimal fibre length (m) of each muscle for which the model states one."""
    origin: str = ""
    """The file of a foreign model."""
    has_tip: bool = True
    """Whether the model says where the fingertip is; otherwise no force is judged."""

    @property
    def missing(self) -> tuple[str, ...]:
        """The muscles of the finger that none was found for; both heads of the first dorsal
        interosseous count as one."""
        wanted = WANTED[self.finger]
        return tuple(m for m in wanted if not set(HEADS.get(m, (m,))) & set(self.tendons))

    @property
    def unread(self) -> tuple[str, ...]:
        """Those of `missing` that were found by name and then dropped."""
        found = {} if self.matched is None else self.matched.how
        return tuple(m for m in self.missing if set(HEADS.get(m, (m,))) & set(found))

    @property
    def losses_of_finger(self) -> tuple[str, ...]:
        """What was lost of the finger itself."""
        return tuple(line for line in self.lost if not OF_OTHERS.search(line))


WANTED: Mapping[str, tuple[str, ...]] = {
    "index": ("EDC", "EI", "LUM", "FPI", "FDP", "FDS", "FDI"),
    "middle": ("EDC", "LUM", "RI", "UI", "FDP", "FDS"),
    "ring": ("EDC", "LUM", "RI", "UI", "FDP", "FDS"),
    "little": ("EDC", "EDM", "LUM", "RI", "ADM", "FDP", "FDS"),
}
HEADS = {"FDI": ("FDIm", "FDIl"), "RI": ("RI", "RIp"), "ADM": ("ADM", "ADMp")}
"""Muscles that are two tendons here."""


def read_hand(
    given: str | Path | Case,
    folder: Path,
    finger: FingerName | None = None,
    names: Mapping[str, str] | None = None,
    tolerance: float = 1e-4,
) -> HandModel:
    """The model of a MuJoCo file (.xml), an OpenSim file (.osim), or a case; what is made of it is
    written into `folder`.  `finger`: the one to judge, the index finger where there is one;
    `names`: from our names to the model's; `tolerance`: m, as of `import_osim`.

    Raises InputError for what cannot be read, and for a model without a finger or a muscle."""
    match given:
        case Case():
            return _of_case(given, finger)
        case str() | Path():
            path = Path(given)
    match path.suffix.lower():
        case ".xml":
            return _of_mjcf(path, path.stem, folder, finger, names or {})
        case ".osim":
            return _of_osim(path, folder, finger, names or {}, tolerance)
    return _of_case(load_case(given), finger)


def _of_case(case: Case, finger: FingerName | None) -> HandModel:
    kind = case.finger.kind
    if kind not in FINGERS or finger not in (None, kind):
        wanted = finger or " or ".join(FINGERS)
        raise InputError(
            f"{case.name}: its finger is of the kind {kind!r}; measured hands are there for the "
            f"{wanted} finger"
        )
    case = case.model_copy(update={"forward": None, "coupling": CouplingConfig()})
    hooded = case.hood.tendon_names(kind)
    own = native_tendons(case.finger, case.hood.left_to_finger)
    tendons = (*(build(case).hood.tendons if hooded is None else hooded), *own)
    strengths = {
        name: t.max_force for name, t in case.tendons.items() if t.max_force and name in tendons
    }
    return HandModel(case.name, "case", kind, case, tendons, strengths=strengths)


def _of_mjcf(
    path: Path,
    name: str,
    folder: Path,
    finger: FingerName | None,
    names: Mapping[str, str],
    imported: Imported | None = None,
    before: Matched | None = None,
) -> HandModel:
    parts = part_names(path)
    where = shown_path(path) if imported is None else imported.source
    which, matched = _choose_finger(where, parts, finger, names)
    if before is not None:
        matched = Matched(matched.names, {**matched.how, **before.how})
    has_tip = TIP in matched.names
    anatomy = UserAnatomy(
        finger=path, names=_there(matched), assumed_tip=None if has_tip else ASSUMED_TIP
    )
    case_path, told = _new_case(name, anatomy, folder)
    hood = attached_hood(path, which)
    case, stated_tendons = load_case(case_path), read_toml(case_path).get("tendons", {})
    if hood is not None:
        case, told = _with_hood(case_path, hood), (*told, _hood_words(hood))
    hooded = case.hood.tendon_names(which) or ()
    tendons = (*hooded, *native_tendons(case.finger, case.hood.left_to_finger))
    if not tendons:
        raise InputError(
            f"{where}: none of its muscles pulls on the {which} finger in a way that can be read: "
            f"{'; '.join(told)}"
        )
    own = (m for m in tendons if m in stated_tendons)
    strengths = {m: force for m in own if (force := case.tendons[m].max_force) is not None}
    strengths |= {} if hood is None else hood["strengths"]
    if imported is not None:
        strengths = _properties(imported, matched, "max_isometric_force")
    lost = (*(() if imported is None else report(imported.losses)), *told)
    return HandModel(
        name,
        "MuJoCo" if imported is None else "OpenSim",
        which,
        case,
        tendons,
        tuple(line.removeprefix("finger: ") for line in lost),
        matched,
        strengths,
        {} if imported is None else _properties(imported, matched, "optimal_fiber_length"),
        where,
        has_tip,
    )


def _new_case(name: str, anatomy: UserAnatomy, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """The case of a foreign finger.  The abduction of a model that turns to the other side than a
    right hand's is taken the other way."""
    text = re.sub(r"[^\w-]", "_", name)[:60].lstrip("_-") or "model"
    try:
        return new_case(text, anatomy, folder / text)
    except UlnarAbductionError:
        side = anatomy.names.get("MCP_abduction", "")
        if side.startswith("-"):
            raise
    turned = {**anatomy.names, "MCP_abduction": f"-{side}"}
    other = UserAnatomy(finger=anatomy.finger, names=turned, assumed_tip=anatomy.assumed_tip)
    path, told = new_case(text, other, folder / text)
    note = f"changed: the joint {side} is taken the other way: radial abduction is positive here"
    return path, (*told, note)


def _with_hood(case_path: Path, hood: Mapping[str, Any]) -> Case:
    """The case of a foreign finger with the hood that `cosim export --attach` put on it."""
    forces = {m: {"max_force": f"{force!r} N"} for m, force in hood["strengths"].items()}
    text = toml_text({"extends": case_path.name, "hood": hood["hood"], "tendons": forces})
    hooded = case_path.with_stem(f"{case_path.stem}_hood")
    hooded.write_text(text, encoding="utf-8")
    return load_case(hooded)


def _hood_words(hood: Mapping[str, Any]) -> str:
    return (
        f"read: the hood of {hood['case']} that cosim export --attach put on this finger, as a "
        "hood of ours; other fixed paths over its back are left out"
    )


def _there(matched: Matched) -> dict[str, str]:
    """The names that differ from ours."""
    return {ours: theirs for ours, theirs in matched.names.items() if ours != theirs}


def _choose_finger(
    where: str, parts: PartNames, finger: FingerName | None, names: Mapping[str, str]
) -> tuple[FingerName, Matched]:
    """The finger that is asked for, or the first whose four joints have names.  Raises InputError
    for a model without, or without a muscle."""
    tried = {f: match_names(parts, f, names) for f in ((finger,) if finger else FINGERS)}
    for which, matched in tried.items():
        if set(JOINTS) <= set(matched.names):
            if not matched.tendons:
                raise InputError(
                    f"{where}: no muscle of the {which} finger was found by name. It has "
                    f"{first_names(parts.tendons, 8)}. Say which is which: a file of lines like "
                    'EDC = "EDCI", and --names FILE'
                )
            return which, matched
    which, matched = next(iter(tried.items()))
    lacking = [joint for joint in JOINTS if joint not in matched.names]
    raise InputError(
        f"{where}: no {' or '.join(tried)} finger was found: no joint is named like "
        f"{', '.join(lacking)}. It has the hinges {first_names(tuple(parts.joints), 8)}. A model "
        "whose fingers are one rigid hand cannot be judged; else say which is which: a file of "
        'lines like PIP = "2pm_flexion", and --names FILE'
    )


def _of_osim(
    path: Path,
    folder: Path,
    finger: FingerName | None,
    names: Mapping[str, str],
    tolerance: float,
) -> HandModel:
    parts = osim_part_names(path)
    _, matched = _choose_finger(str(path), parts, finger, names)
    imported = import_osim(path, tolerance, sorted(matched.tendons.values()))
    folder.mkdir(parents=True, exist_ok=True)
    written, *_ = write_import(imported, folder / f"{path.stem}.xml")
    given = {m: theirs for m, theirs in matched.names.items() if m not in matched.tendons}
    usable = {m: t for m, t in matched.tendons.items() if t in imported.muscles}
    if not usable:
        raise InputError(
            f"{path}: none of the finger's muscles could be imported within "
            f"{1e3 * tolerance:g} mm of OpenSim's lengths; a wider --tolerance takes those that "
            f"are off by less: {_beyond(imported)}"
        )
    joints = {ours: given[ours] for ours in given if ours in (*JOINTS, TIP)}
    return _of_mjcf(
        written, path.stem, folder, finger, {**names, **joints, **usable}, imported, matched
    )


def _beyond(imported: Imported) -> str:
    sizes = (f"{name} {1e3 * size:.2g} mm" for name, size in imported.beyond.items())
    return ", ".join(sizes) or "none"


def _properties(imported: Imported, matched: Matched, which: str) -> dict[str, float]:
    """A number that the file states of its muscles, by our names, SI."""
    found = {}
    for ours, theirs in matched.tendons.items():
        muscle = imported.muscles.get(theirs)
        match None if muscle is None else muscle.properties.get(which):
            case float(value):
                found[ours] = value
    return found


def without_loads(case: Case) -> Case:
    """The case with its muscles' greatest forces, and nothing that pulls."""
    return case.model_copy(update={"tendons": {n: pulling(t) for n, t in case.tendons.items()}})


def pulling(tendon: TendonConfig, tension: float | None = None) -> TendonConfig:
    """A tendon with this tension (N) alone; None: at rest."""
    kept = TendonConfig().model_copy(update={"max_force": tendon.max_force})
    return kept.model_copy(update={"tension": tension})
