"""The READMEs: their Python blocks and commands run, their figures are the board's, their links
lead somewhere."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cases.papers.models.networks.testbed_study import REPORTED_ERRORS, errors, trials
from cosim.case.file import load_case, packaged_cases
from cosim.cli import app
from cosim.models.build import hood_mesh
from cosim.pipeline import run_case
from cosim.results.conventions import vector_of
from cosim.study.plan import read_plan
from cosim.text_tables import packaged_files
from tests.golden import read_golden
from tests.helpers.board import ANSWERS, in_each_hand, read_board, trust_rows
from tests.helpers.folders import ROOT
from tests.proofs.hoods.network_study_rows import SEEDS
from tests.proofs.studies.lesion_rows import CUTS, HOODS, changes, cut_case

READMES = (
    "",
    "cosim",
    "cosim/analyses",
    "cosim/case",
    "cosim/fmu",
    "cosim/results",
    "cosim/scoring",
    "cosim/solve",
    "cosim/study",
    "cosim/ui",
    "cosim/validation",
    "cases/papers",
    "fe_solver",
    "fe_solver/febio",
    "rigid",
    "meshes",
    "cases",
    "tests",
)
PAGES = {place: ROOT / place / "README.md" for place in READMES}
PAGES["cosim/developers"] = ROOT / "cosim" / "DEVELOPERS.md"
TEXTS = {place: path.read_text(encoding="utf-8") for place, path in PAGES.items()}
TOP, TRUST = TEXTS[""], TEXTS["cosim/validation"]
BLOCKS = {
    f"{place or 'top'}-{i}": block
    for place, text in TEXTS.items()
    for i, block in enumerate(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
}
FIRST = "cosim run isometric_edc"


def is_long(command: str, note: str) -> bool:
    """Whether it takes more than half a minute: as it says, or the first run once more."""
    return "minute" in note or "--out pulled" in command


TEN = TOP.partition("\n## Ten commands\n")[2].partition("\n## ")[0]
COMMANDS = [
    pytest.param(command.strip(), marks=[pytest.mark.slow] * is_long(command, note))
    for command, _, note in (
        line.strip().partition(" #") for line in TEN.splitlines() if line.startswith("    cosim ")
    )
]


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n == "top-0")) for n in BLOCKS]
)
def test_a_python_block_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(BLOCKS[name], name, "exec"), {"__name__": "__main__"})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the first run of the README, of a coarser mesh, has left its results."""
    made = tmp_path_factory.mktemp("readme")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(made)
        words = [*shlex.split(FIRST)[1:], "--set", "hood.mesh.quads=120"]
        done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    return made


def test_the_first_run_leaves_the_files_that_are_named(folder: Path):
    table = TOP.partition("\n## The first run\n")[2].partition("\n## ")[0]
    named = {file for row in re.findall(r"^\| (`.*?) \|", table, re.M) for file in row.split(", ")}
    left = {f"`{path.name}`" for path in (folder / "runs" / "isometric_edc").iterdir()}
    assert named == left


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_runs(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(app, shlex.split(command)[1:])
    assert done.exit_code == 0, done.output


def test_there_are_ten_commands():
    assert len(COMMANDS) == 10


def test_the_set_up_is_what_the_continuous_integration_runs():
    command = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()[-1]
    assert f"    {command}\n" in TOP
    assert f"&& .venv/bin/{FIRST}\n" in TOP


def test_the_figures_of_trust_are_the_boards():
    rows = trust_rows()
    for row in rows.values():
        assert row in TRUST.replace("**", "")


def test_the_figures_of_uncertainty_are_those_that_were_found():
    text = " ".join(TRUST.split())
    board = read_board()
    judged = board["judged"]["cadaver forces: hood"]["judgements"]
    hood, zero, half, split = (judged[answer]["within uncertainty"] for answer in ANSWERS)
    assert f"{hood} of the {sum(judged['model'].values())} forces" in text
    assert f"{zero} of the zeros, {half} of half of the hood's forces and {split} of the" in text
    rows = board["groups"]["cadaver forces: hood"]
    for part in ("u_num", "u_input"):
        low, high = (end(row[part] for row in rows) for end in (min, max))
        assert f"by {low:.1g} to {high:.2g} N" in text


def test_the_figures_of_each_hand_are_the_boards():
    text, judged = " ".join(TRUST.split()), read_board()["judged"]["cadaver forces: hood"]
    each, perfect = in_each_hand(judged["by_hand"]).split("; ")
    first, second, third = each.split(", ")
    (over_zero,) = (s for s in judged["skill"] if s["null"] == "no answer")
    assert f"beside the mean of the hands, and {first}, {second} and {third} beside each." in text
    assert f"from {over_zero['low']:.2g} to {over_zero['high']:.2g}." in text
    assert f"a perfect model would expect {perfect}." in text


@pytest.mark.parametrize("place", PAGES)
def test_links_lead_somewhere(place: str):
    for link in re.findall(r"\]\((?!https?:)([^)]*)\)", TEXTS[place]):
        file, _, heading = link.partition("#")
        target = (PAGES[place].parent / file).resolve() if file else PAGES[place]
        assert target.exists(), link
        if heading:
            said = target.read_text(encoding="utf-8")
            titles = re.findall(r"^#+ (.*)$", said, re.MULTILINE)
            assert heading in [re.sub(r"[^\w -]", "", t.lower()).replace(" ", "-") for t in titles]


def test_the_catalogue_has_every_family_with_its_picture():
    folders = {path.parent.name for path in (ROOT / "cases").glob("*/*.toml")}
    families = folders - {"base", "data", "studies", "repairs"}
    text = TEXTS["cases"]
    counts = dict(re.findall(r"^\| \[(\w+)\]\(#\w+\) \| .* \| (\d+) \|$", text, re.MULTILINE))
    assert {name: int(count) for name, count in counts.items()} == {
        name: len(list((ROOT / "cases" / name).glob("*.toml"))) for name in families
    }
    for name in families:
        picture = ROOT / "cases" / name / "picture.png"
        assert f"\n## {name}\n" in text
        assert f"]({name}/picture.png)" in text
        assert picture.read_bytes().startswith(b"\x89PNG")
        assert picture.stat().st_size < 80_000


CATALOGUE, PAPERS = TEXTS["cases"], TEXTS["cases/papers"]


def table_under(text: str, head: str) -> list[list[str]]:
    """The rows of the table whose first line begins so, without their marks of code and links."""
    lines = text[text.index(f"\n{head}") + 1 :].splitlines()[2:]
    rows = lines[: next(i for i, line in enumerate([*lines, ""]) if not line.startswith("|"))]
    return [[cell.strip() for cell in row.strip("| ").split("|")] for row in rows]


def figures(text: str) -> list[float]:
    return [float(figure) for figure in re.findall(r"[-+]?\d+(?:\.\d+)?", text)]


def rounded(values: Iterable[float], shown: Sequence[float], digits: int) -> bool:
    """Whether the values are those shown, within half of the last digit and rounding."""
    return list(values) == pytest.approx(shown, abs=0.51 * 10.0**-digits)


def test_the_catalogue_counts_every_case():
    counted = {row[0]: int(row[2]) for row in table_under(CATALOGUE, "| family |")}
    folders = {re.findall(r"\w+", family)[0]: n for family, n in counted.items()}
    for family, n in folders.items():
        assert len(list((ROOT / "cases" / family).glob("*.toml"))) == n, family
    assert sum(folders.values()) == len(packaged_cases())


def test_the_catalogue_says_what_the_fingertip_s_hoods_are_made_of():
    meshes = [hood_mesh(load_case(f"fingertip_{law}_edc")) for law in ("fibres", "isotropic")]
    assert {mesh.quads.shape for mesh in meshes} == {(416, 4)}
    section = CATALOGUE.partition("\n## fingertip\n")[2].partition("\n## ")[0]
    assert "416 quads of four nodes" in section
    assert "nine" not in section


NUMBERS = (
    "two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen".split()
)
ALL_TEXTS = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in [*ROOT.rglob("*.md"), *ROOT.glob("cases/**/*.py"), ROOT / "pyproject.toml"]
    if not {"node_modules", ".venv", "build"} & {*path.parts}
}


def amount(word: str) -> int:
    """The number that a word or digits say."""
    return int(word) if word.isdigit() else NUMBERS.index(word.lower()) + 2


def test_what_texts_count_is_as_many_as_there_are():
    """Of notebooks, packaged studies and cases, whose lists grow."""
    there = {
        "notebooks": len(list(ROOT.glob("cases/notebooks/[!_]*.py"))),
        "studies": len(packaged_files("studies")),
        "cases": len(packaged_cases()),
    }
    each = rf"\b(\d+|{'|'.join(NUMBERS)}) ((?:shipped|packaged) )?(notebooks|studies|cases)\b"
    said = [
        (place, number, bool(shipped), kind)
        for place, text in ALL_TEXTS.items()
        for number, shipped, kind in re.findall(each, text, re.IGNORECASE)
    ]
    wrong = [
        (place, number, kind)
        for place, number, shipped, kind in said
        if (shipped or kind == "notebooks") and amount(number) != there[kind.lower()]
    ]
    assert wrong == []


def test_no_text_says_how_long_a_machine_took():
    """That is the clock's of one day: seconds, minutes or hours are enough, and each command says
    itself how long it has to go."""
    unit = "s|seconds|min|minutes|h|hours"
    took = rf"\b(?:some|about|takes)\s+(?:\d+|{'|'.join(NUMBERS)})\s(?:{unit})\b"
    assert all(re.search(took, text) for text in ("some 8 min", "about 15 s", "takes two minutes"))
    guides = {place: text for place, text in ALL_TEXTS.items() if place.endswith("README.md")}
    found = {place: each for place, text in guides.items() if (each := re.findall(took, text))}
    assert found == {}


def test_a_study_solves_as_many_cases_as_is_said():
    runs = len(read_plan("network_saltelli").points)
    assert f"one case solved {runs} times" in TOP
    assert f"# {runs} runs of a network" in TEXTS["cosim/study"]
    bands = read_plan("input_uncertainty", "split_edc", samples=60)
    assert f"# {len(bands.as_it_is) + bands.count} runs; the count" in TEXTS["cosim/study"]


def test_the_robot_s_forces_are_those_of_golden_json():
    said = figures(re.search(r"same\s+4 N: (.*?) N dorsally", CATALOGUE, re.DOTALL)[1])
    golden = read_golden()
    cases = [f"robot_{kind}_extensor" for kind in ("pulleys", "network", "cable")]
    dorsal = [golden[case]["summary"]["fingertip_force_N"]["dorsal"] for case in cases]
    assert rounded(dorsal, said, 2)


def test_the_table_of_lengths_is_the_board_s():
    board = read_board()
    groups = ("lengths and cuts", "lengths and cuts: other loads and places")
    rows = {row["quantity"]: row["model"] for group in groups for row in board["groups"][group]}
    kinds = ("terminal_1mm", "terminal_4mm", "central_gap_pip", "central_gap_dip")
    keys = [[f"{kind}_{load}_deg" for load in ("tone", "stronger_flexors")] for kind in kinds]
    keys += [[f"{cut}_{angle}_at_the_PIP_N" for angle in (0, 45)] for cut in ("bands", "tendon")]
    keys += [[f"glide_{joint}_mm" for joint in ("mcp", "pip", "dip")]]
    keys += [["resistance_most_deg", "resistance_least_deg"], ["oblique_share_percent"]]
    shown = [row[2] for row in table_under(CATALOGUE, "| experiment | measured |")]
    for cell, names in zip(shown, keys, strict=True):
        digits = len(re.findall(r"\d+(?:\.(\d+))?", cell)[0])
        found = [rows[f"measured.{name}"] for name in names]
        assert cell.split(" / ").count("-") == found.count(None), names
        assert rounded([f for f in found if f is not None], figures(cell), digits), names


@pytest.mark.slow
def test_the_isometric_table_is_what_the_cases_say():
    for muscle, tension, force, size, _, slips in table_under(CATALOGUE, "| muscle | tension, N |"):
        name = "edc" if muscle == "at rest" else muscle.lower()
        whole = run_case(load_case(f"isometric_{name}")).summary
        summary = whole["unloaded"] if muscle == "at rest" else whole
        pulled = sum(t for key, t in summary["tension_N"].items() if key.startswith(muscle))
        assert rounded([pulled or summary["tension_N"]["EDC"]], figures(tension), 2)
        assert rounded(vector_of(summary["fingertip_force_N"]), figures(force), 2)
        assert rounded([summary["fingertip_magnitude_N"]], figures(size), 2)
        if slips != "-":
            assert rounded(summary["slip_force_N"].values(), figures(slips), 2)


@pytest.mark.slow
def test_the_first_look_is_what_the_first_run_says():
    summary = run_case(load_case("isometric_edc")).summary
    for name, key in (("tip_force", "fingertip_force_N"), ("slips", "slip_force_N")):
        said = re.search(rf"print\(result\.{name}\).*?: (\{{.*\}})", TOP)[1]
        assert {k: round(v, 2) for k, v in summary[key].items()} == json.loads(said)
    assert f"force of {summary['fingertip_magnitude_N']:.2f} N." in TOP.replace("\n", " ")
    assert f" {summary['hood_quads']}, " in TEXTS["meshes"]


@pytest.mark.slow
def test_the_table_of_lesions_is_what_the_hoods_say():
    for injury, *cells in table_under(CATALOGUE, "| | shell | cables |"):
        part = CUTS["boutonniere" if "boutonniere" in injury else "mallet"]
        for cell, case in zip(cells, HOODS, strict=True):
            found = changes(cut_case(case, part))
            assert rounded([found["PIP"], found["DIP"]], figures(cell), 1), (injury, case)
    for name, words in (
        ("lateral_band", r"band drops the DIP by (\S+) deg"),
        ("terminal_shortened", r"shorter extends the DIP by (\S+) deg"),
    ):
        said = figures(re.search(words, CATALOGUE)[1])
        assert rounded([abs(changes(load_case(f"lesion_{name}"))["DIP"])], said, 1)


@pytest.mark.slow
def test_the_virtual_testbed_s_errors_are_what_it_says():
    found = errors(trials(SEEDS))
    for experiment, ours, paper in table_under(PAPERS, "| | ours | paper |"):
        assert figures(paper) == list(REPORTED_ERRORS[experiment])
        for mean, said in zip(found[experiment].mean(axis=0), ours.split(" / "), strict=True):
            assert rounded([mean], [float(said)], 2 if "." in said else 0)
