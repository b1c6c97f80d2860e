"""The files that validations read and leave: models of pydantic, checked and written in one way."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from cosim.errors import InputError
from cosim.files import write_text
from cosim.json_text import json_text


class Record(BaseModel):
    """A file or a part of one: frozen, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


Model = TypeVar("Model", bound=BaseModel)


def check_record(model: type[Model], content: Any, place: Path | str) -> Model:
    """The content of `place` as a model.  Raises InputError with the place and the first fault."""
    try:
        return model.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"])) or "the file"
        words = first["msg"].removeprefix("Value error, ")
        raise InputError(f"{place}: {key}: {words}") from None


def write_record(path: Path, record: BaseModel) -> None:
    """Write a model as JSON, to six digits.  Raises InputError where the file cannot be written."""
    content = six_digits(record.model_dump(mode="json"))
    write_text(path, json_text(content, ensure_ascii=True) + "\n")


def six_digits(value: Any) -> Any:
    """A float to six digits, those of lists and tables too, anything else as it is."""
    match value:
        case float():
            return float(f"{value:.6g}")
        case dict():
            return {key: six_digits(inner) for key, inner in value.items()}
        case list():
            return [six_digits(inner) for inner in value]
    return value
