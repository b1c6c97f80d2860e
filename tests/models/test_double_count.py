"""Forces that a coupling would count twice are named and refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from cosim.case.file import load_case, packaged_cases
from cosim.cli import app
from cosim.errors import InputError
from cosim.models.double_count import double_counted_pairs, pairs_of_case
from cosim.models.fit import check_fit
from cosim.pipeline import run_case

PACKAGED = sorted(packaged_cases())
FDP = (
    'hood.paths.FDP=[{body="metacarpal", point=["-1 cm", "0 mm", "-8 mm"]},'
    ' {body="distal", point=["2 mm", "0 mm", "-4 mm"]}]'
)
ALLOWED = "coupling.allow_double_counting=true"


@pytest.mark.parametrize(
    ("source", "finger"),
    [
        ("joint_contact", "joint"),
        ("Joint reaction", "joint"),
        ("passive", "passive"),
        ("limit", "limit"),
        ("gravity", "gravity"),
        ("inertia", "inertia"),
        ("fingertip", "fingertip"),
        ("muscle EDC", "muscle"),
        ("FDP", "FDP"),
        ("FDP_pull", "FDP"),
    ],
)
def test_a_source_that_the_finger_makes_is_found(source, finger):
    (pair,) = double_counted_pairs(("contact", source), ("EDC",), ("FDP",))
    assert (pair.hood, pair.finger) == (source, finger)
    assert str(pair) == f"hood {source} and {finger}"


def test_what_only_a_hood_does_is_no_pair():
    sources = ("central_slip", "contact", "guide", "terminal_slip", "lumping", "jointed", "spring")
    assert double_counted_pairs(sources, ("EDC", "EI"), ("FDP", "FDS")) == ()


def test_a_tendon_on_both_sides_is_found():
    (pair,) = double_counted_pairs(("eyelets",), ("EDC", "FDP"), ("FDP", "FDS"))
    assert pair.hood == pair.finger == "tendon FDP"


@pytest.mark.parametrize("name", PACKAGED)
def test_only_the_thesis_cases_count_twice_and_say_so(name):
    case = load_case(name)
    check_fit(case)
    found = [str(pair) for pair in pairs_of_case(case, ())]
    is_thesis = name.startswith("thesis_one_way")
    assert found == (["hood joint_contact and joint"] if is_thesis else [])
    assert case.coupling.allow_double_counting == is_thesis


@pytest.mark.parametrize(
    ("name", "settings", "named", "remedy"),
    [
        (
            "thesis_one_way_edc",
            ["coupling.allow_double_counting=false"],
            '"hood joint_contact" and the finger\'s own "joint"',
            'coupling.one_way.joint_contact = "none"',
        ),
        (
            "pulley_edc",
            [FDP],
            '"hood tendon FDP" and the finger\'s own "tendon FDP"',
            "leave tendon FDP out",
        ),
    ],
)
def test_check_and_run_refuse_it_with_the_pair_named(name, settings, named, remedy):
    words = [word for setting in settings for word in ("--set", setting)]
    done = CliRunner().invoke(app, ["check", name, *words])
    assert done.exit_code == 2
    for words in (named, remedy, "coupling.allow_double_counting = true"):
        assert words in done.stderr
    with pytest.raises(InputError, match="counted twice"):
        run_case(load_case(name, settings))


def test_a_hood_from_outside_is_judged_by_the_names_that_the_case_gives_it(tmp_path: Path):
    unit = tmp_path / "hood.fmu"
    unit.write_bytes(b"")
    text = 'extends = "isometric_edc"\n[hood]\nkind = "fmu"\npath = "hood.fmu"\ntendons = ["EDC"]\n'
    for source, complaint in (("passive", 'own "passive"'), ("joint_contact", "leave the source")):
        path = tmp_path / "case.toml"
        path.write_text(text + f'sources = ["contact", "{source}"]\n')
        with pytest.raises(InputError, match=complaint):
            check_fit(load_case(path))


def test_a_case_that_means_it_runs_and_its_summary_names_the_pair():
    result = run_case(load_case("pulley_edc", [FDP, ALLOWED]))
    assert result.summary["double_counted"] == ["hood tendon FDP and tendon FDP"]
    assert "double_counted" not in run_case(load_case("pulley_edc")).summary


@pytest.mark.parametrize(
    ("name", "settings", "complaint"),
    [
        ("split_edc", ['coupling.scheme="one_way"'], r'does not go with hood\.kind = "split"'),
        (
            "pulley_edc",
            ['coupling.scheme="one_way"', 'forward.duration="1 s"'],
            "does not go with forward",
        ),
        ("pulley_edc", ['coupling.scheme="explicit"'], r"takes steps in time.*\[forward\]"),
        ("pulley_edc", ['coupling.scheme="jacobi"'], "takes steps in time"),
        ("pulley_edc", ["coupling.one_way.muscles=false"], "needs scheme"),
        ("pulley_edc", ['coupling.one_way.joint_contact="middle"'], "joint_contact"),
    ],
)
def test_schemes_that_do_not_fit_are_refused(name, settings, complaint):
    with pytest.raises(InputError, match=complaint):
        check_fit(load_case(name, settings))


def test_a_planar_finger_without_mass_has_no_centres_of_mass(tmp_path: Path):
    path = tmp_path / "hinge.toml"
    path.write_text(
        'title = "hinge"\n[finger]\nkind = "hinge"\nlengths = ["46 mm", "26 mm", "20 mm"]\n'
        'posture = { MCP = "30 deg", PIP = "45 deg", DIP = "15 deg" }\n'
        '[hood]\nkind = "pulley"\n[hood.paths]\n'
        'EDC = [{ body = "metacarpal", point = ["-1 cm", "0 mm", "8 mm"] }, '
        '{ body = "proximal", point = ["1 cm", "0 mm", "8 mm"] }]\n'
        '[coupling]\nscheme = "one_way"\n[coupling.one_way]\nlumping = "centre_of_mass"\n'
    )
    with pytest.raises(InputError, match=r'finger\.kind = "hinge" has no mass'):
        check_fit(load_case(path))
    check_fit(load_case(path, ['coupling.one_way.lumping="bodies"']))
