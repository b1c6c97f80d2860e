"""What a unit's archive holds has a number, and a unit of another number ends in one message."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.fmu.unit import Unit
from cosim.fmu_export.write import write_fmu
from cosim.version import FMU_FORMAT, __version__
from tests.helpers.fmus import NEEDS_FMU, change_archive
from tests.helpers.hang import HANG

pytestmark = NEEDS_FMU
BOTH = pytest.mark.parametrize("fmi", [2, 3])
LAYOUT = "6ce88985"
"""Digest of what a unit of FMU_FORMAT holds and imports of the program."""


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> dict[int, Path]:
    folder = tmp_path_factory.mktemp("format")
    for fmi in (2, 3):
        write_fmu(load_case("pulley_edc"), "hood", fmi, folder / f"{fmi}.fmu", tangent=False)
    return {fmi: folder / f"{fmi}.fmu" for fmi in (2, 3)}


def test_the_format_has_another_number_where_the_layout_is_another(written):
    """Where this fails: raise `cosim.version.FMU_FORMAT` by one, and write the new digest here."""
    facts = []
    for fmi, path in written.items():
        with zipfile.ZipFile(path) as archive:
            names = [n for n in archive.namelist() if "pythonfmu" not in n and "binaries" not in n]
            script = archive.read(f"resources/cosim_fmu{fmi}.py").decode()
            about = json.loads(archive.read("resources/about.json"))
        uses = re.findall(r"from cosim\S* import .*|self\.run\.\w+|self\._\w+", script)
        facts.append([sorted(names), sorted(about), sorted(set(uses))])
    assert about["format"] == FMU_FORMAT == 3
    assert hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:8] == LAYOUT


def with_about(source: Path, target: Path, **facts: object) -> Path:
    def change(text: bytes) -> bytes:
        kept = {**json.loads(text), **facts}
        return json.dumps({k: v for k, v in kept.items() if v is not None}).encode()

    return change_archive(source, target, {"resources/about.json": change})


@BOTH
@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"format": None}, f"by cosim-hand {__version__} in format 1, .* which runs format 3"),
        ({"format": 99}, r"in format 99, and this Python has cosim-hand \S+, which runs format 3"),
        ({"version": "0.0.1"}, r"written by cosim-hand 0\.0\.1"),
        ({"version": None}, "does not describe a unit"),
    ],
)
def test_another_format_or_version_says_so(tmp_path, written, fmi, facts, words):
    with pytest.raises(InputError, match=words):
        Unit(with_about(written[fmi], tmp_path / "old.fmu", **facts))


@BOTH
def test_another_simulator_is_told_so_too(tmp_path, written, fmi):
    """FMPy alone: of another format, and of a layout whose modules are gone; neither may hang."""
    path = with_about(written[fmi], tmp_path / "old.fmu", format=1)
    gone = change_archive(
        written[fmi],
        tmp_path / "gone.fmu",
        {f"resources/cosim_fmu{fmi}.py": lambda t: t.replace(b"cosim.fmu_export", b"cosim.gone")},
    )
    code = "import sys, fmpy; fmpy.simulate_fmu(sys.argv[1], stop_time=1e-3, debug_logging=True)"
    for unit, words in (
        (path, "in format 1, and this Python has cosim-hand"),
        (gone, f"needs cosim-hand {__version__} with its extra fmu, which runs FMUs of format 3"),
    ):
        done = subprocess.run(
            [sys.executable, "-c", code, str(unit)],
            capture_output=True,
            text=True,
            check=False,
            timeout=HANG,
        )
        assert done.returncode != 0
        assert words in done.stdout + done.stderr
