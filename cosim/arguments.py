"""Arguments of the public face: each kind is read in one place, and a wrong one is an InputError
that says what was expected."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeGuard, cast

import numpy as np

from cosim.case.file import case_of, layers_of, load_case, resolved_toml
from cosim.case.schema import Case, as_stated, check_name
from cosim.errors import InputError, unexpected
from cosim.files import is_path
from cosim.models.build import build
from cosim.port import Finger, Hood, Pair
from cosim.results.read import check_converged, read_run
from cosim.results.result import Result
from cosim.schema import units
from cosim.solve.session import Session

CASE = "the name of a packaged case, the path of a case file, a table, a Case or a Result"
RUN = "a Result, or the folder of a run"


def case_from(given: object, settings: Sequence[str] = (), place: str = "case") -> Case:
    """The case that is meant, checked; `settings` come on top of a name, a path or a table.

    >>> case_from("pulley_edc") == case_from(case_from("pulley_edc"))
    True

    Raises InputError."""
    texts = tuple(settings) if is_several(settings) else (None,)
    if not all(isinstance(text, str) for text in texts):
        raise unexpected("settings", "a list of texts KEY=VALUE", settings)
    settings = texts
    match given:
        case Case():
            return given.with_layers(layers_of(settings)) if settings else given
        case Result() if given.folder is not None:
            return load_case(given.folder / "case.toml", settings).model_copy(
                update={"name": given.case}
            )
        case Result():
            return case_of(given.case_table, given.case, settings)
        case Mapping():
            return case_of(given, overrides=settings)
        case _ if is_path(given):
            return load_case(given, settings)
    raise unexpected(place, CASE, given)


def cases_from(given: object) -> list[Case]:
    """Several cases, each as `case_from` takes it.  Raises InputError."""
    if is_several(given):
        return [case_from(case, place=f"cases[{i}]") for i, case in enumerate(given)]
    raise unexpected("cases", f"a list of cases, each {CASE}", given)


def is_several(given: object) -> TypeGuard[Iterable[Any]]:
    """Whether it is a list, or anything else that cases come out of one by one."""
    return isinstance(given, Iterable) and not isinstance(given, str | bytes | Mapping | Case)


def result_from(given: object, place: str = "result") -> Result:
    """The result that is meant.  Raises InputError."""
    if isinstance(given, Result):
        check_converged(given.summary, place)
        return given
    if is_path(given):
        return read_run(Path(given))
    if isinstance(given, Case):
        raise InputError(f"{place}: expected {RUN}, not a case; solve it first: cosim.run(case)")
    raise unexpected(place, RUN, given)


def session_from(given: object) -> Session | None:
    """What runs share, if anything.  Raises InputError."""
    if given is None or isinstance(given, Session):
        return given
    raise unexpected("session", "a Session or None", given)


def whole_number(place: str, given: object, least: int, most: int) -> int:
    """A whole number within bounds.

    >>> whole_number("workers", 2, 1, 1024)
    2

    Raises InputError."""
    number = as_stated(given)
    if isinstance(number, bool) or not isinstance(number, int) or not least <= number <= most:
        raise unexpected(place, f"a whole number from {least} to {most}", given)
    return number


def quantity_in_si(place: str, given: object, kind: units.Kind, least: float = -math.inf) -> float:
    """The SI value of a number in SI units, a text with a unit or a quantity of pint.

    >>> quantity_in_si("tension", "300 mN", units.FORCE)
    0.3

    Raises InputError where it is none, is not finite or is below `least`."""
    value = as_stated(given)
    if isinstance(value, str):
        try:
            value = units.parse(value, kind)
        except ValueError as error:
            raise InputError(f"{place} = {given!r}: {error}") from error
    if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
        expected = f'a finite number in {kind.si}, or a text with its unit ("{kind.example}")'
        raise unexpected(place, expected, given)
    if value < least:
        raise InputError(f"{place} = {given!r}: must be {least:g} {kind.si} or more")
    return float(value)


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond the range of floating point
        return False


def fraction(place: str, given: object) -> float:
    """A number above 0 and below 1.  Raises InputError."""
    number = as_stated(given)
    if isinstance(number, bool) or not isinstance(number, float) or not 0 < number < 1:
        raise unexpected(place, "a number above 0 and below 1", given)
    return number


def by_name(place: str, given: object, example: str) -> Mapping[str, Any]:
    """Values by name.  Raises InputError."""
    if isinstance(given, Mapping) and all(isinstance(name, str) for name in given):
        return given
    raise unexpected(place, f"values by name, for example {example}", given)


def by_name_or_in_order(
    place: str, given: object, names: Sequence[str], example: str
) -> Mapping[str, Any]:
    """Values by name; a list or an array of as many as there are names is one for each in order.

    >>> by_name_or_in_order("action", [1.0, 2.0], ("EDC", "FDP"), '{"EDC": 1.0}')
    {'EDC': 1.0, 'FDP': 2.0}

    Raises InputError."""
    is_sized = isinstance(given, list | tuple) or (isinstance(given, np.ndarray) and given.ndim)
    values = cast(Sequence[Any], given if is_sized else ())
    if is_sized and len(values) == len(names):
        return dict(zip(names, values, strict=True))
    return by_name(place, given, f"{example}, or {len(names)} numbers: {', '.join(names)}")


def real_number(given: object) -> float:
    """A number of Python or numpy, also in an array without axes; nan for what is none.

    >>> real_number(np.array(2)), real_number(np.float32(0.5)), real_number(1j), real_number(True)
    (2.0, 0.5, nan, nan)
    """
    value = given[()] if isinstance(given, np.ndarray) and given.shape == () else given
    is_other = isinstance(value, bool | np.timedelta64)  # which count as whole numbers
    if is_other or not isinstance(value, int | float | np.integer | np.floating):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf


def pair_from(finger: object, hood: object) -> tuple[Pair, Mapping[str, float], Any]:
    """Finger and hood of `couple`, the posture (rad) of a finger that a case has, and what tells
    the forces in the slips of a hood that one has.  Raises InputError."""
    of_finger = None if _offers(finger, Finger) else case_from(finger, place="finger")
    of_hood = None if _offers(hood, Hood) else case_from(hood, place="hood")
    if of_finger is not None and of_hood is not None:
        tables = {"hood": of_hood.hood, "lesion": of_hood.lesion}
        models = build(of_finger.model_copy(update=tables))
        return models.pair, models.posture, models.slips_of
    if of_finger is not None:
        models = build(of_finger)
        return Pair(models.finger, cast(Hood, hood)), models.posture, None
    if of_hood is not None:
        models = build(of_hood)
        of_state = models.built.slips
        slips = None if of_state is None else lambda solved: of_state(solved.response.state)
        return Pair(cast(Finger, finger), models.hood), {}, slips
    return Pair(cast(Finger, finger), cast(Hood, hood)), {}, None


def _offers(given: object, port: type) -> bool:
    """Whether it has all that a class of the port asks for."""
    asked = [name for name in vars(port) if not name.startswith("_")]
    return all(hasattr(given, name) for name in asked)


def case_file(case: Any, folder: Path, place: str) -> str | Path:
    """What names the case: as it is given, or a file of it in the folder.  Raises InputError."""
    if is_path(case):
        return case
    checked = case_from(case, place=place)
    file = folder / f"{check_name(checked.name)}.toml"
    file.write_text(resolved_toml(checked), encoding="utf-8")
    return file


def run_folder(run: object, place: Path, name: str) -> Path:
    """The folder of a run, which a result that has none gets at `place`.  Raises InputError."""
    if is_path(run):
        return Path(run)
    result = result_from(run, name)
    return result.save(place) if result.folder is None else result.folder
