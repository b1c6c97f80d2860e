"""Values that a case states as text: how each is read, written and described in the schema."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeGuard

from pydantic_core import PydanticCustomError, core_schema

from cosim.errors import InputError
from cosim.files import check_file_size
from cosim.schema import units
from cosim.schema.units import Kind


@dataclass(frozen=True)
class Text:
    """Metadata of a value that a case states as text (or as lists of text); how it is read, written
    and described."""

    read: Callable[[Any], Any]
    write: Callable[[Any], Any]
    schema: tuple[tuple[str, Any], ...]
    """What a JSON Schema says of it; `title` is its form in words."""
    pattern: Callable[[], str] | None = None
    """The regular expression of the text, made where it is asked for."""
    kind: Kind | None = None
    """The kind of a quantity."""
    least: str = ""
    """The least value of a quantity, or what it must be above; empty where there is none."""
    most: str = ""
    """The greatest value of a quantity; empty where there is none."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        write = core_schema.plain_serializer_function_ser_schema(self.write, when_used="json")
        return core_schema.no_info_plain_validator_function(self.read, serialization=write)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        pattern = {} if self.pattern is None else {"pattern": self.pattern()}
        return {"type": "string", **pattern, **dict(self.schema)}


def fault(message: str) -> PydanticCustomError:
    """A fault in the words that the user will read."""
    return PydanticCustomError("fault", "{message}", {"message": message})


def check_texts(values: Any, *place: str) -> None:
    """Raise a fault where a name or a text among `values` holds what no file can: half of a
    character, or a control character that no line of text has."""
    match values:
        case str() if not values.isprintable():
            if wrong := next((c for c in values if _has_no_place_in_a_file(c)), None):
                where = ".".join(place)
                raise fault(f"{where}: holds the character U+{ord(wrong):04X}, which no file can")
        case dict():
            for key, value in values.items():
                check_texts(key, *place, repr(key))
                check_texts(value, *place, str(key))
        case list() | tuple():
            for i, value in enumerate(values):
                check_texts(value, *place, str(i))


def _has_no_place_in_a_file(character: str) -> bool:
    kind = unicodedata.category(character)
    return kind == "Cs" or (kind == "Cc" and character not in "\n\r\t")


def is_number(value: object) -> TypeGuard[float]:
    """Whether it is a number, and no truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _read_quantity(kind: Kind, above: str, least: str, most: str, value: Any) -> float:
    advice = kind.advice
    if not isinstance(value, str):
        raise fault(f"{'is a bare number' if is_number(value) else 'is not text'}; {advice}")
    try:
        number = units.parse(value, kind)
    except ValueError as error:
        raise fault(str(error)) from None
    if above and number <= units.parse(above, kind):
        raise fault(f"must be above {above}")
    if least and number < units.parse(least, kind):
        raise fault(f"must be {least} or more")
    if most and number > units.parse(most, kind):
        raise fault(f"must be {most} or less")
    return number


def quantity(
    kind: Kind, *, above: str = "", least: str = "", most: str = "", word: str = ""
) -> Text:
    """A quantity with its range; `word` may stand in its place."""

    def read(value: Any) -> Any:
        if word and value == word:
            return word
        return _read_quantity(kind, above, least, most, value)

    def write(value: Any) -> str:
        return word if word and value == word else units.spell(value, kind)

    bounds = [("above", above), ("at least", least), ("at most", most), ("or the word", word)]
    limits = ", ".join(f"{name} {bound}" for name, bound in bounds if bound)
    form = f"{kind.name} with its unit" + (f": {limits}" if limits else "")

    def pattern() -> str:
        return units.pattern(kind) + (f"|^{word}$" if word else "")

    schema = ("title", form), ("examples", (kind.example,))
    return Text(read, write, schema, pattern, kind, above or least, most)


def name_of(what: str, names: tuple[str, ...], also: tuple[str, ...] = ()) -> Text:
    """One of a list of names, as the key of a table; `also`: keys that a file may have and that are
    replaced before the names are read."""

    def read(value: Any) -> str:
        if value not in names:
            context = {"what": what, "names": (*names, *also)}
            raise PydanticCustomError("unknown_name", "is not a {what}", context)
        return str(value)

    return Text(read, str, (("enum", (*names, *also)),))


def existing_file(most: int) -> Text:
    """A path; that the file exists and has at most `most` bytes is checked."""
    return Text(partial(_read_file, most), str, (("title", "path of a file"),))


def _read_file(most: int, value: Any) -> Path:
    if not isinstance(value, str):
        raise fault("is not text; write the path of a file")
    if not os.path.isfile(value):
        raise fault("no such file; a path is relative to the case file that states it")
    try:
        check_file_size(Path(value), most)
    except InputError as error:
        raise fault(str(error).removeprefix(f"{value}: ")) from None
    return Path(value)
