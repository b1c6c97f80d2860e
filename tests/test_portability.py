"""What is known to differ between Linux, macOS and Windows, as far as Linux can show it."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from cosim import files
from cosim.analyses.identify.parameters import read_free
from cosim.case import file
from cosim.case.file import load_case
from cosim.errors import CosimError, InputError
from cosim.files import replace_folder
from cosim.processes import ProcessEndedError, WorkerProcess
from cosim.study.plan import read_plan
from cosim.validation.plan import groups
from cosim.validation.run import folder_name
from tests.helpers.folders import ROOT
from tests.proofs.fe import json_command

PACKAGES = ("cosim", "fe_solver", "rigid", "meshes", "cases")
SOURCES = [path for name in PACKAGES for path in sorted((ROOT / name).rglob("*.py"))]
RESERVED = {"con", "prn", "aux", "nul", *(f"{n}{i}" for n in ("com", "lpt") for i in range(10))}
POSIX_MODULES = {"resource", "fcntl", "pwd", "grp", "termios", "pty"}
POSIX_NAMES = {"os.fork", "os.killpg", "os.setsid", "os.getuid", "os.mkfifo", "signal.SIGKILL"}
ASKS = ("sys.platform", "os.name")
BOM = "\ufeff"


@cache
def trees() -> dict[Path, ast.Module]:
    """The packages' files, parsed once for all tests."""
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES}


def calls(tree: ast.AST) -> Iterator[tuple[str, ast.Call]]:
    """Every call of a name, with its last part."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Attribute):
                yield node.func.attr, node
            elif isinstance(node.func, ast.Name):
                yield node.func.id, node


def leaves_encoding_open(name: str, call: ast.Call) -> bool:
    """Whether the encoding of a text is that of the machine: cp1252 on many a Windows."""
    words = {keyword.arg for keyword in call.keywords}
    if "encoding" in words:
        return False
    if name == "read_text":
        return not call.args
    if name == "write_text":
        return len(call.args) < 2
    if name in ("open", "fdopen"):
        texts = [a.value for a in call.args if isinstance(a, ast.Constant)]
        is_binary = any(isinstance(text, str) and "b" in text for text in texts)
        owner = ast.unparse(call.func).removesuffix("open").lower()
        return not is_binary and not any(word in owner for word in ("store", "image", "os."))
    if name in ("run", "Popen", "check_output"):
        return bool({"text", "universal_newlines"} & words)
    return False


def test_the_scan_sees_what_it_is_for():
    texts = ("p.read_text()", "p.write_text(a)", "open(p)", "p.open('w')", "run(c, text=True)")
    fine = ("p.read_text('utf-8')", "open(p, 'rb')", "Store(p).open()", "run(c)")
    found = [leaves_encoding_open(*next(calls(ast.parse(text)))) for text in (*texts, *fine)]
    assert found == [True] * len(texts) + [False] * len(fine)


def test_every_text_file_has_its_encoding_named():
    found = [
        f"{source.relative_to(ROOT).as_posix()}:{call.lineno}"
        for source, tree in trees().items()
        for name, call in calls(tree)
        if leaves_encoding_open(name, call)
    ]
    assert found == []


def dotted(node: ast.AST) -> str:
    """A name of a module's ("os.fork"), "" of any other node."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return f"{node.value.id}.{node.attr}"
    return ""


def posix_names(node: ast.AST) -> set[str]:
    """What a node names that only POSIX has."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names} & POSIX_MODULES
    if isinstance(node, ast.ImportFrom):
        return {node.module or ""} & POSIX_MODULES
    return {dotted(node)} & POSIX_NAMES


def posix_alone(tree: ast.AST) -> Iterator[str]:
    """What only POSIX has, outside of the functions that ask which system this is."""
    found = [(node, names) for node in ast.walk(tree) if (names := posix_names(node))]
    functions = [n for n in ast.walk(tree) if found and isinstance(n, ast.FunctionDef)]
    asking = [f for f in functions if any(dotted(node) in ASKS for node in ast.walk(f))]
    behind = {id(node) for function in asking for node in ast.walk(function)}
    for node, names in found:
        if id(node) not in behind:
            yield from names


def test_what_only_posix_has_stands_behind_a_question():
    asks = "def f():\n    if sys.platform != 'win32':\n        os.killpg(1, signal.SIGKILL)"
    assert set(posix_alone(ast.parse("import resource\nos.fork()"))) == {"resource", "os.fork"}
    assert list(posix_alone(ast.parse(asks))) == []
    for source, tree in trees().items():
        assert list(posix_alone(tree)) == [], source


def test_every_file_can_lie_on_windows_and_on_a_disk_that_knows_no_case():
    paths = [
        path.relative_to(ROOT).as_posix()
        for name in (*PACKAGES, "tests")
        for path in (ROOT / name).rglob("*")
        if "__pycache__" not in path.parts
    ]
    assert [p for p, times in Counter(path.lower() for path in paths).items() if times > 1] == []
    for path in paths:
        assert not set(path) & set('<>:"\\|?*'), path
        for part in path.split("/"):
            assert part.split(".")[0].lower() not in RESERVED, path
            assert part[-1] not in ". ", path


def test_the_folders_of_validation_differ_in_more_than_case():
    trials = {trial.name for group in groups(None) for trial in group.trials}
    assert len({folder_name(name).lower() for name in trials}) == len(trials)


def test_a_pipe_with_a_code_page_shows_what_it_lacks_as_a_question_mark(tmp_path):
    text = 'extends = "pulley_edc"\ntitle = "5 µm \u4e2d"\noutput.picture = false\n'
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", "from cosim.cli import main; main()", "run", "a.toml"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "cp1252"},
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "a: 5 µm ?" in done.stdout.decode("cp1252")


def test_a_file_that_another_process_holds_is_waited_for(tmp_path, monkeypatch):
    part, target = tmp_path / "part", tmp_path / "target"
    part.write_text("new", encoding="utf-8")
    real, tries = Path.replace, []

    def held(self: Path, place: Path) -> None:
        tries.append(place)
        if len(tries) < 3:
            raise PermissionError(13, "in use")
        real(self, place)

    monkeypatch.setattr(Path, "replace", held)
    monkeypatch.setattr(files, "MOVE_LIMIT", 0.0)
    with pytest.raises(PermissionError):
        files.move_into_place(part, target)
    monkeypatch.setattr(files, "MOVE_LIMIT", 5.0)
    files.move_into_place(part, target)
    assert len(tries) == 3
    assert target.read_text(encoding="utf-8") == "new"


def test_a_folder_whose_place_cannot_be_taken_leaves_the_old_one(tmp_path, monkeypatch):
    part, target = tmp_path / ".run.part", tmp_path / "run"
    for folder, text in ((part, "new"), (target, "old")):
        folder.mkdir()
        (folder / "a").write_text(text, encoding="utf-8")
    real = Path.replace

    def held(self: Path, place: Path) -> None:
        if self == part:
            raise PermissionError(13, "in use")
        real(self, place)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", held)
        with pytest.raises(PermissionError):
            replace_folder(target, part)
    assert (target / "a").read_text(encoding="utf-8") == "old"
    replace_folder(target, part)
    assert (target / "a").read_text(encoding="utf-8") == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_pipe_to_a_process_that_ended_need_not_say_broken_pipe(monkeypatch):
    """Windows says that the argument is invalid."""

    def invalid(*_: object) -> None:
        raise OSError(22, "Invalid argument")

    worker = WorkerProcess()
    try:
        worker.call(abs, -1)
        monkeypatch.setattr(Connection, "send_bytes", invalid)
        with pytest.raises(ProcessEndedError, match="exit code 0"):
            worker.call(abs, -1)
    finally:
        worker.end()


def test_a_process_that_crashed_on_windows_is_known_by_its_exit_code(monkeypatch):
    done = subprocess.CompletedProcess([], 0xC0000005, "", "")
    monkeypatch.setattr(json_command.subprocess, "run", lambda *_, **__: done)
    with pytest.raises(CosimError, match="crashed: 0xc0000005"):
        json_command.run_json_command([], {})


def test_a_case_on_another_drive_is_named_by_its_whole_path(tmp_path, monkeypatch):
    def raise_value_error(*_: object) -> str:
        raise ValueError("path is on mount 'C:', start on mount 'D:'")

    source = tmp_path / "a.toml"
    monkeypatch.setattr(os.path, "relpath", raise_value_error)
    assert file.base_name(source, tmp_path) == source.resolve().as_posix()


def test_files_of_a_windows_editor_are_read(tmp_path):
    """With its mark of UTF-8 at the start and its line ends."""
    case = tmp_path / "a.toml"
    case.write_bytes(f'{BOM}extends = "pulley_edc"\r\ntitle = "A"\r\n'.encode())
    assert load_case(case).title == "A"
    study = tmp_path / "s.toml"
    text = (
        f'{BOM}case = "a.toml"\n[parameters.PIP]\nvalues = ["20 deg"]\n'
        'settings = ["finger.posture.PIP={value}"]\n[outputs]\nforce = "fingertip_magnitude_N"\n'
    )
    study.write_bytes(text.replace("\n", "\r\n").encode())
    assert len(read_plan(study).points) == 1
    free = tmp_path / "p.toml"
    free.write_bytes(f"{BOM}a = 1\r\n".encode())
    with pytest.raises(InputError, match="expected a table"):
        read_free(free, load_case("strain_lee2008_average_ti"))


def test_an_older_python_is_told_which_one_is_needed():
    for name in ("__init__.py", "__main__.py", "version.py"):  # what is read before the message
        text = (ROOT / "cosim" / name).read_text(encoding="utf-8")
        ast.parse(text, feature_version=(3, 7))
    program = "import sys; sys.version_info = (3, 9, 1); sys.argv = [{!r}]; import cosim"
    for word, code, first in (("-m", 2, "cosim needs"), ("x.py", 1, "Traceback")):
        call = [sys.executable, "-c", program.format(word)]
        done = subprocess.run(call, capture_output=True, text=True, cwd=ROOT)
        assert done.returncode == code
        assert done.stderr.startswith(first)
        assert "cosim needs Python 3.11 or newer, and this is 3.9" in done.stderr


@pytest.mark.slow
def test_pictures_are_drawn_whatever_backend_the_environment_names(tmp_path):
    code = f"import cosim; cosim.run('split_edc').save({str(tmp_path / 'python')!r})"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "none_such"}
    for command in (["-c", code], ["-m", "cosim", "run", "split_edc", "--quiet", "-o", "command"]):
        done = subprocess.run(
            [sys.executable, "-W", "error", *command],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        folder = tmp_path / ("python" if "-c" in command else "command") / "split_edc"
        assert {"picture.png", "ledger.png"} <= {p.name for p in folder.iterdir()}
