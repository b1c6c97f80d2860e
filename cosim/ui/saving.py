"""What a page leaves: runs, their report, and the case file of what it states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from cosim.case.file import base_name, load_case, resolved_toml
from cosim.case.schema import Case
from cosim.report.page import write_report
from cosim.results.result import Result
from cosim.schema.json_schema import CASE_SCHEMA, schema_line
from cosim.text_tables import toml_settings, toml_text
from cosim.ui.controls import settings_of


def save_run(result: Result, name: str, out: Path) -> Path:
    """Write a result under a name; its folder.  Raises InputError where it cannot be written."""
    return replace(result, name=name, summary={**result.summary, "case": name}).save(out)


def write_page_report(folder: Path, name: str, shown: Result, pinned: Result | None) -> Path:
    """Write the report of what is shown, beside what is pinned; its file.  Raises InputError."""
    run, against = save_run(shown, name, folder / "now"), None
    if pinned is not None:
        against = save_run(pinned, f"{pinned.case}_pinned", folder / "pin")
    file = folder / "report.html"
    write_report([run], file, "html", against)
    return file


def case_file_text(case: Case, stated: Case, changes: Mapping[str, str] | None) -> str:
    """The TOML of a case: settings on top of the file that states it, with `changes` of its
    controls; whole where these are no settings (None: another hood was chosen) or no file does."""
    settings = None if changes is None else settings_of(stated, changes)
    is_of_file = stated.source.is_file() and (
        resolved_toml(load_case(stated.source)) == resolved_toml(stated)
    )
    if settings is None or not is_of_file:
        return resolved_toml(case)
    base = base_name(stated.source, Path.cwd())
    head = toml_text({"extends": base, "title": f"{stated.title}, changed"})
    return f"{schema_line(CASE_SCHEMA)}\n{head}{toml_settings(settings)}"
