"""A validation packed for others: a crate, read as untrusted input, and what differs from it."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rocrate.rocrate import ROCrate
from typer.testing import CliRunner

from cosim.cli import app
from cosim.errors import InputError
from cosim.validation import package, repeat
from cosim.validation.package import METADATA, README, Request, command, request_of
from cosim.validation.repeat import differences, read_package

ONLY = "middle_minorflex_fdp"
Files = dict[str, bytes]


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packed")
    words = ["validate", "--only", ONLY, "--workers", "1", "-o", str(folder / "runs")]
    done = CliRunner().invoke(app, [*words, "--package", str(folder / "board.zip")])
    assert done.exit_code == 0, done.output
    return folder / "board.zip"


def files_of(path: Path) -> Files:
    with zipfile.ZipFile(path) as archive:
        return {e.filename: archive.read(e) for e in archive.infolist()}


def packed_anew(files: Files, path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def changed(files: Files, name: str, change: Callable[[Any], None]) -> Files:
    """The files with one of JSON changed, and its hash in the metadata with it."""
    content = json.loads(files[name])
    change(content)
    text = json.dumps(content).encode()
    metadata = json.loads(files[METADATA])
    for entity in metadata["@graph"]:
        if entity["@id"] == name:
            entity["sha256"] = package.hashlib.sha256(text).hexdigest()
    return {**files, name: text, METADATA: json.dumps(metadata).encode()}


def test_the_package_is_a_whole_crate(packed: Path, tmp_path: Path):
    files = files_of(packed)
    graph = {e["@id"]: e for e in json.loads(files[METADATA])["@graph"]}
    assert graph[METADATA]["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert graph[METADATA]["about"] == {"@id": "./"}
    root = graph["./"]
    assert {"name", "description", "license", "datePublished"} <= root.keys()
    assert {p["@id"] for p in root["hasPart"]} == files.keys() - {METADATA}
    assert all(graph[name]["@type"] == "File" for name in files.keys() - {METADATA})
    named = [p["@id"] for k in ("object", "result") for p in graph["#validate"][k]]
    assert sorted(named) == sorted(files.keys() - {METADATA})
    with zipfile.ZipFile(packed) as archive:
        archive.extractall(tmp_path)
    crate = ROCrate(tmp_path)
    assert crate.root_dataset["mentions"][0]["instrument"]["name"] == "cosim-hand"
    text = files[README].decode()
    assert f'cosim validate --only "{ONLY}"' in text
    assert "{" not in text


def test_the_same_program_finds_the_same(packed: Path, tmp_path: Path):
    words = ["validate", "--repeat", str(packed), "--workers", "1", "-o", str(tmp_path / "again")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "6 numbers compared\n" in done.output
    for what in ("numbers", "versions", "inputs"):
        assert f"{what}: none differs" in done.output


def found(files: Files, board: bytes, tmp_path: Path) -> repeat.Differences:
    return differences(read_package(packed_anew(files, tmp_path / "p.zip")), board.decode())


def test_what_differs_is_said(packed: Path, tmp_path: Path):
    files = files_of(packed)
    board = files["scoreboard.json"]
    group, *_ = json.loads(board)["groups"]

    def move(content: Any) -> None:
        rows = content["groups"][group]
        rows[0]["model"] *= 1.002
        rows[1]["model"] *= 1 + 1e-5
        rows[2]["name"] = "another"

    differ = found(changed(files, "scoreboard.json", move), board, tmp_path)
    assert len(differ.numbers) == 3
    assert sum("alone" in line for line in differ.numbers) == 2
    assert differ.compared == 5
    assert [*differ.versions, *differ.inputs] == []

    def age(content: Any) -> None:
        content["python"] = "3.9.1"
        content["packages"]["numpy"] = "1.0"
        content["packages"]["gone"] = "2"

    differ = found(changed(files, "versions.json", age), board, tmp_path)
    assert [line.partition(":")[0] for line in differ.versions] == ["Python", "gone", "numpy"]
    case = "inputs/cases/base/index_finger.toml"
    other = {**files, case: files[case] + b"\n"}
    metadata = json.loads(other[METADATA])
    for entity in metadata["@graph"]:
        if entity["@id"] == case:
            entity["sha256"] = package.hashlib.sha256(other[case]).hexdigest()
    differ = found({**other, METADATA: json.dumps(metadata).encode()}, board, tmp_path)
    assert differ.inputs == [f"'{case}': differs"]
    assert not differ.numbers


def test_a_package_whose_numbers_differ_ends_with_code_one(
    packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    files = files_of(packed)
    group, *_ = json.loads(files["scoreboard.json"])["groups"]
    path = packed_anew(
        changed(files, "scoreboard.json", lambda c: c["groups"][group][0].update(model=None)),
        tmp_path / "p.zip",
    )

    def judge(groups: Any, asked: Any, out: Path, places: list[Path]) -> None:
        out.mkdir()
        places[0].write_bytes(files["scoreboard.json"])

    monkeypatch.setattr("cosim.commands.validate._judge", judge)
    done = CliRunner().invoke(app, ["validate", "--repeat", str(path), "-o", str(tmp_path / "o")])
    assert done.exit_code == 1
    assert "numbers: 1 differ" in done.output


def drop(name: str) -> Callable[[Files], Files]:
    return lambda files: {k: v for k, v in files.items() if k != name}


def put(name: str, content: bytes) -> Callable[[Files], Files]:
    return lambda files: {**files, name: content}


def edit(name: str, change: Callable[[Any], None]) -> Callable[[Files], Files]:
    return lambda files: changed(files, name, change)


def set_to(**values: Any) -> Callable[[Any], None]:
    return lambda content: content.update(values)


FAULTS: dict[str, tuple[Callable[[Files], Files], str]] = {
    "slip": (put("../evil.txt", b"x"), "outside of its folder"),
    "absolute": (put("/etc/evil", b"x"), "outside of its folder"),
    "twice": (put("readme.MD", b"x"), "more than once"),
    "no metadata": (drop(METADATA), METADATA),
    "no board": (drop("scoreboard.json"), "scoreboard.json"),
    "a run is gone": (drop(f"runs/{ONLY}/summary.json"), "is not there"),
    "more than it says": (put("inputs/more.txt", b"x"), "not in ro-crate"),
    "wrong hash": (put("versions.json", b"{}"), "was changed"),
    "no crate": (put(METADATA, b"[]"), "no metadata of an RO-Crate"),
    "another crate": (put(METADATA, b'{"@graph": [{"@id": "./"}]}'), "does not conform"),
    "spoilt metadata": (put(METADATA, b"\xff{"), "not valid JSON"),
    "deep metadata": (put(METADATA, b"[" * 200_000), "not valid JSON"),
    "another format": (edit("request.json", set_to(format="2")), "request.json: format"),
    "a file of ours": (edit("request.json", set_to(settings=["hood.mesh=/etc/x.feb"])), "no file"),
    "too many meshes": (edit("request.json", set_to(meshes=99)), "request.json: meshes"),
    "an escape": (edit("versions.json", set_to(python="\x1b[2J")), "versions.json: python"),
    "no numbers": (edit("scoreboard.json", set_to(groups={"a": [{"model": "x"}]})), "scoreboard"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_package_is_one_message(packed: Path, tmp_path: Path, fault: str):
    spoil, words = FAULTS[fault]
    path = packed_anew(spoil(files_of(packed)), tmp_path / "p.zip")
    done = CliRunner().invoke(app, ["validate", "--repeat", str(path), "-o", str(tmp_path / "o")])
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())
    assert "Traceback" not in done.output
    assert not (tmp_path / "o").exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["p.zip"]


@pytest.mark.parametrize("content", [b"", b"PK", b"no zip at all", None])
def test_what_is_no_archive_is_one_message(packed: Path, tmp_path: Path, content: bytes | None):
    path = tmp_path / "p.zip"
    path.write_bytes(packed.read_bytes()[:-2000] if content is None else content)
    with pytest.raises(InputError, match="cannot be read as a package"):
        read_package(path)
    with pytest.raises(InputError, match="cannot be read as a package"):
        read_package(tmp_path / "none.zip")


def test_a_bomb_is_refused_before_it_is_unpacked(
    packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(repeat, "MOST_BYTES", 8 << 20)
    bomb = packed_anew({**files_of(packed), "inputs/b": bytes(9 << 20)}, tmp_path / "p.zip")
    with pytest.raises(InputError, match="unpacks to"):
        read_package(bomb)
    monkeypatch.setattr(repeat, "MOST_PACKED", 1000)
    with pytest.raises(InputError, match="at most"):
        read_package(packed)


@pytest.mark.parametrize(
    "setting",
    ["hood.mesh.quads=150", 'finger.posture.MCP="30 deg"', "a.b=-1.5e-3", "k=12 N/mm", "x=[1, 2]"],
)
def test_a_setting_that_names_no_file_is_packed(setting: str):
    request = request_of(settings=(setting,), only="lee")
    assert command(request) == f"cosim validate --only \"lee\" --set '{setting}'"
    assert Request.model_validate_json(request.model_dump_json()) == request


@pytest.mark.parametrize(
    "setting",
    [
        *("hood.mesh=a.feb", "x=/etc/passwd", "x=C:/a", "x=\\\\host\\a", "x='../b'", "x=", "x=~a"),
        *("hood.mesh.path=hood", "hood.points_file = dots", "finger.bones.middle.surface=bone"),
    ],
)
def test_a_setting_that_may_name_a_file_is_not(setting: str):
    with pytest.raises(InputError, match="no file"):
        request_of(settings=(setting,))


def test_options_that_do_not_fit_are_refused(packed: Path, tmp_path: Path):
    for words in (
        ["--repeat", str(packed), "--only", "lee"],
        ["--package", str(tmp_path / "board.tar")],
        ["--package", str(tmp_path / "b.zip"), "--published", "mi29.feb"],
    ):
        done = CliRunner().invoke(app, ["validate", *words])
        assert done.exit_code == 2
        assert "Traceback" not in done.output
