import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.case.file import (
    NO_FAMILIES,
    find_case,
    json_schema,
    load_case,
    packaged_cases,
    resolved_toml,
)
from cosim.case.layers import merge
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.schema import units
from tests.helpers.folders import ROOT

PACKAGED = sorted(packaged_cases())
KINDS = [kind for kind in vars(units).values() if isinstance(kind, units.Kind)]


def faults(*overrides: str) -> str:
    with pytest.raises(InputError) as caught:
        load_case("isometric_edc", overrides)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("0.65 mm", units.LENGTH, 0.65e-3),
        ("105 MPa", units.PRESSURE, 105e6),
        ("30°", units.ANGLE, math.pi / 6),
        ("20 N*m/deg", units.LIMIT_STIFFNESS, 20 * 180 / math.pi),
        ("20 Nm/deg", units.LIMIT_STIFFNESS, 20 * 180 / math.pi),
        ("100 N/mm**3", units.CONTACT_STIFFNESS, 100e9),
        ("100 N/mm^3", units.CONTACT_STIFFNESS, 100e9),
        ("-1e-2cm", units.LENGTH, -1e-4),
        ("3 N/mm", units.STIFFNESS, 3e3),
    ],
)
def test_quantities_become_si(text, kind, value):
    assert units.parse(text, kind) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "kind", "complaint"),
    [
        ("0.6", units.LENGTH, "has no unit"),
        ("3 kg", units.LENGTH, "`kg` is no unit of length"),
        ("20 N*m", units.LIMIT_STIFFNESS, "no unit of torque per angle"),
        ("nan mm", units.LENGTH, "not finite"),
        ("-inf mm", units.LENGTH, "not finite"),
        ("1e999 mm", units.LENGTH, "not finite"),
        ("3 furlong", units.LENGTH, "`furlong` is not a unit known here"),
        ("3 (mm", units.LENGTH, "is not a unit"),
        ("thick", units.LENGTH, "not a number with a unit"),
        ("", units.LENGTH, "not a number with a unit"),
    ],
)
def test_a_bad_quantity_is_refused_with_what_to_write(text, kind, complaint):
    with pytest.raises(ValueError, match="write a") as caught:
        units.parse(text, kind)
    assert complaint in str(caught.value)
    assert kind.example in str(caught.value)


@given(st.sampled_from(KINDS), st.floats(-1e12, 1e12, allow_subnormal=False))
def test_a_spelled_quantity_reads_back_exactly(kind, value):
    assert units.parse(units.spell(value, kind), kind) == value


@given(st.text(max_size=30), st.sampled_from(KINDS))
def test_any_text_is_a_finite_quantity_or_a_value_error(text, kind):
    try:
        assert math.isfinite(units.parse(text, kind))
    except ValueError as error:
        assert kind.example in str(error)


@pytest.mark.parametrize("name", PACKAGED)
def test_packaged_cases_load_and_their_active_tendon_is_in_their_name(name):
    """FDI has two heads; the strains were measured under EDC."""
    case = load_case(name)
    active = [
        name
        for name, tendon in case.tendons.items()
        if case.tension(name) > case.solve.resting_tension
        or tendon.actuation is not None
        or tendon.excursion is not None
    ]
    named = ["EDC"] if name.startswith(("strain", "thesis_strain")) else name.upper().split("_")
    if name.startswith("network_contact"):  # figure 4 of its paper: five muscles in turn
        named = ["EDC", "LUM", "FPI", "FDP", "FDS"]
    if name == "hood_rest":
        named = ["EDC"]
    if name.startswith(("motion_flexion", "lesion", "lengths", "cuts")):  # all of the finger
        named = ["E", "L", "F"]
    if name in ("robot_friction_cycle", "robot_motor_flexor"):  # a flexor against the extensor
        named = ["DIP_FLEXOR", "EXTENSOR"]
    assert active or name == "lengths_dip_resistance"  # of a hood at rest
    assert all(any(tendon.upper().startswith(part) for part in named) for tendon in active)


def test_values_are_si():
    case = load_case("isometric_fdi")
    assert case.finger.posture.angles() == pytest.approx(
        {"MCP": math.pi / 6, "MCP_abduction": 0, "PIP": math.pi / 4, "DIP": math.pi / 12}
    )
    assert case.tension("FDIm") == pytest.approx(0.05 * 72.8)
    assert case.tension("EDC") == 0.05
    assert case.hood.thickness == 0.15e-3
    assert case.hood.regions["central_slip"].c5 == 100.76e6
    assert case.finger.limit.stiffness == pytest.approx(20 / math.radians(1))


@pytest.mark.parametrize(
    "overrides",
    [
        (),
        (
            "finger.kind=hinge",
            *(f"finger.posture.{joint}=10 deg" for joint in ("MCP", "PIP", "DIP")),
            'finger.lengths=["46 mm", "28 mm", "20 mm"]',
            'finger.limit={half_range="0.3 rad", stiffness="7 Nm/rad", transition="1 deg"}',
        ),
        (
            "hood.kind=pulley",
            'hood.paths.EDC=[{body="metacarpal", point=["-1 cm", "0 mm", "8 mm"]},'
            ' {body="distal", point=["3 mm", "0.1 mm", "2 mm"]}]',
        ),
        ('title=a "quoted" \\ title \t', "tendons.EI.tension=0.1234567890123456789 N"),
    ],
)
def test_the_resolved_case_loads_to_the_same_case(tmp_path: Path, overrides):
    case = load_case("isometric_edc", overrides)
    copy = tmp_path / "isometric_edc.toml"
    copy.write_text(resolved_toml(case), encoding="utf-8")
    again = load_case(copy)
    assert again.model_copy(update={"source": case.source}) == case


BAD = {
    "a bare number": ("hood.thickness=0.6", "hood.thickness = 0.6", "is a bare number"),
    "another dimension": ("hood.thickness=3 kg", "hood.thickness", "no unit of length"),
    "a key of an earlier version": (
        'tendons.EDC.course={kind="points",at=[["0 s",1.0]]}',
        "tendons.EDC.course",
        "is now called signal",
    ),
    "an unknown key": ("hood.mesh.qads=250", "hood.mesh.qads = 250", "did you mean quads?"),
    "an unknown region": (
        "hood.regions.central_slit.poisson=0.3",
        "hood.regions.central_slit",
        "unknown region; did you mean central_slip?",
    ),
    "not a number": ("solve.tolerance=nan", "solve.tolerance = nan", "finite"),
    "not a number with unit": ("hood.thickness=nan mm", "hood.thickness", "not finite"),
    "a negative modulus": (
        "hood.regions.central_slip.c5=-3 MPa",
        "hood.regions.central_slip.c5 = '-3 MPa'",
        "must be above 0 MPa",
    ),
    "out of range": ("finger.posture.MCP=95 deg", "finger.posture.MCP", "must be 90 deg or less"),
    "a missing mesh": (
        'hood.mesh={kind="file", path="no.vtu"}',
        "hood.mesh.path",
        "no such file",
    ),
    "a tendon in other letters": ("tendons.edc.tension=1 N", "tendons.edc", "named twice"),
    "an unknown kind": ("hood.kind=membrane", "hood.kind", "write 'shell' or 'pulley'"),
    "another word": (
        "finger.tip.kind=hold",
        "finger.tip.kind = 'hold'",
        "write 'point' or 'clamped' or 'free'",
    ),
    "a head of no bone": (
        'hood.contact.heads.knuckle={face="1 mm", sides="1 mm"}',
        "hood.contact.heads.knuckle",
        "unknown key; known: metacarpal, proximal, middle",
    ),
    "a head covered by less than nothing": (
        "hood.contact.heads.proximal.face=-1 mm",
        "hood.contact.heads.proximal.face = '-1 mm'",
        "must be 0 mm or more",
    ),
    "no table": ("hood.contact=3", "hood.contact = 3", "must be a table, [hood.contact]"),
    "truth for a number": ("hood.mesh.quads=true", "hood.mesh.quads", "integer"),
    "a missing unit in a list": ("finger.gravity=[1, 2, 3]", "finger.gravity[2] = 3", "bare"),
    "a short list": ('finger.gravity=["1 m/s^2"]', "finger.gravity[1]", "too short"),
    "two thicknesses": (
        'hood.regions.central_slip={thickness="1 mm", section="1 mm**2"}',
        "hood.regions.central_slip",
        "both thickness and section",
    ),
    "two ways at once": (
        'tendons.EDC={tension="1 N", activation=0.1}',
        "tendons.EDC",
        "both tension and activation",
    ),
    "a key like a tag": ("hood.shell=3", "hood.shell = 3", "unknown key"),
    "a key like a mark": ("[key]=3", "'[key]' = 3", "unknown key"),
    "a tendon like a tag": ("tendons.kind=EDC", "tendons.kind = 'EDC'", "unknown tendon"),
    "a bare number in a row": (
        "tendons.EDC={activation=0.1, max_force=0}",
        "tendons.EDC.max_force = 0",
        "write a force",
    ),
    "a table that is not there": (
        'finger={kind="hinge"}',
        "finger.posture: is missing",
        "write the table [finger.posture] with MCP, PIP, DIP",
    ),
}


@pytest.mark.parametrize(("override", "place", "advice"), BAD.values(), ids=BAD.keys())
def test_a_fault_is_told_with_its_place_and_what_to_write(override, place, advice):
    message = faults(override)
    lines = [line for line in message.splitlines() if line.strip().startswith(place)]
    (line,) = [line for line in lines if advice in line]
    assert "(setting " in line or "is missing" in line


def test_all_faults_are_told_at_once():
    message = faults(
        "hood.thickness=3", "solve.x=1", "finger.posture.PIP=-1 deg", "output.picture=1"
    )
    assert "4 faults" in message
    assert [line.split()[0] for line in message.splitlines()[1:]] == sorted(
        ["hood.thickness", "solve.x", "finger.posture.PIP", "output.picture"]
    )


def test_a_missing_region_of_the_generated_mesh_is_named(tmp_path: Path):
    text = resolved_toml(load_case("isometric_edc"))
    head, rest = text.split("[hood.regions.terminal_slip]\n")
    (tmp_path / "a.toml").write_text(head + rest[rest.index("[") :])
    with pytest.raises(InputError, match="also has terminal_slip"):
        load_case(tmp_path / "a.toml")


def test_an_activation_needs_a_greatest_force(tmp_path: Path):
    text = resolved_toml(load_case("isometric_edc")).replace('max_force = "34.69 N"\n', "")
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match=r"tendons\.EDC .*without max_force"):
        load_case(tmp_path / "a.toml")


@pytest.mark.parametrize("bad", ["quads", "=3", "a..b=1", ".=2", ""])
def test_an_override_must_be_key_and_value(bad):
    assert "write key=value" in faults(bad)


def test_an_override_replaces_the_other_way_to_say_it():
    assert load_case("isometric_edc", ["tendons.EDC.tension=3.4 N"]).tension("EDC") == 3.4
    back = ["tendons.EDC.tension=3.4 N", "tendons.EDC.activation=0.2"]
    assert load_case("isometric_edc", back).tension("EDC") == pytest.approx(0.2 * 34.69)


def test_a_table_of_another_kind_replaces_the_old_one():
    base = {"mesh": {"kind": "generated", "quads": 600}, "t": 1}
    over = {"mesh": {"kind": "file", "path": "x"}}
    assert merge(base, over) == {"mesh": {"kind": "file", "path": "x"}, "t": 1}
    assert merge(base, {"mesh": {"quads": 9}})["mesh"] == {"kind": "generated", "quads": 9}


def test_paths_are_relative_to_the_file_that_states_them(tmp_path: Path, monkeypatch):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "hood.vtu").touch()
    (tmp_path / "sub" / "base.toml").write_text(
        'extends = "isometric_edc"\nhood.mesh = {kind = "file", path = "hood.vtu"}\n'
    )
    (tmp_path / "case.toml").write_text('extends = "sub/base.toml"\nsolve.max_iterations = 7\n')
    case = load_case(tmp_path / "case.toml")
    assert case.hood.mesh.path == tmp_path / "sub" / "hood.vtu"
    assert case.solve.max_iterations == 7
    monkeypatch.chdir(tmp_path / "sub")
    case = load_case("../case.toml", ["hood.mesh.path=hood.vtu"])
    assert case.hood.mesh.path == tmp_path / "sub" / "hood.vtu"


def test_a_fault_names_the_file_that_states_it(tmp_path: Path):
    (tmp_path / "base.toml").write_text('extends = "isometric_edc"\nhood.thickness = 3\n')
    (tmp_path / "case.toml").write_text('extends = "base.toml"\ntitle = "x"\n')
    with pytest.raises(InputError, match=r"hood\.thickness = 3 \(.*base\.toml\)"):
        load_case(tmp_path / "case.toml")


def test_files_that_extend_each_other_are_refused(tmp_path: Path):
    (tmp_path / "a.toml").write_text('extends = "b.toml"')
    (tmp_path / "b.toml").write_text('extends = "a.toml"')
    with pytest.raises(InputError, match=r"circle: .*a\.toml -> .*b\.toml -> .*a\.toml"):
        load_case(tmp_path / "a.toml")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ('[tendons]\nEDC = {tension = "1 N"}\nEDC = {tension = "2 N"}\n', "line 3, .* given twice"),
        ("[tendons.EDC]\n[tendons.EDC]\n", "line 2, .* given twice"),
        ("title = \n", "line 1"),
        ("title = 'x", "not valid TOML"),
        ("x = " + "9" * 5000, "not valid TOML"),
        ("x = " + "[" * 5000, "nested too deeply|not valid TOML"),
        (".".join("a" * 3000) + " = 1", "nested too deeply|fault"),
        ("extends = 3", "write the path of a case file"),
        ("extends = 'nowhere'", "no such file"),
        ("hood = [{kind = 'shell'}]", "hood"),
    ],
)
def test_a_bad_file_is_refused_with_its_place(tmp_path: Path, text, complaint):
    path = tmp_path / "case.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint) as caught:
        load_case(path)
    assert "case.toml" in str(caught.value)


def test_a_file_that_is_not_text_is_refused(tmp_path: Path):
    (tmp_path / "case.toml").write_bytes(b"\xff\x00")
    with pytest.raises(InputError, match="UTF-8"):
        load_case(tmp_path / "case.toml")


def test_a_case_that_is_nowhere_names_the_packaged_ones():
    with pytest.raises(InputError, match="isometric_edc"):
        load_case("isometric_abc")


@pytest.mark.parametrize("path", ["cases/isometric_edc.toml", "../x/isometric_edc.toml"])
def test_a_path_to_a_packaged_case_that_is_gone_is_answered_with_its_name(path: str, tmp_path):
    with pytest.raises(InputError, match=r"write its name: isometric_edc$"):
        load_case(path)
    (tmp_path / "mine.toml").write_text(f'extends = "{path}"\n')
    with pytest.raises(InputError, match=r"mine\.toml: extends .*write its name: isometric_edc$"):
        load_case(tmp_path / "mine.toml")


def test_every_packaged_case_has_a_name_of_its_own_and_a_family():
    files = [path.relative_to(ROOT / "cases") for path in (ROOT / "cases").rglob("*.toml")]
    cases = [file for file in files if file.parts[0] not in NO_FAMILIES]
    assert {len(file.parts) for file in cases} == {2}
    assert sorted(file.stem for file in cases) == PACKAGED
    for file in cases:
        assert find_case(file.stem) == find_case(file) == ROOT / "cases" / file


KEYS = st.sampled_from(
    "title finger finger.kind finger.posture finger.posture.MCP finger.passive.PIP.rest tendons "
    "tendons.EDC tendons.EDC.tension tendons.EDC.activation hood hood.kind hood.mesh "
    "hood.mesh.kind hood.mesh.quads hood.mesh.path hood.regions hood.regions.central_slip "
    "hood.springs.central_slip.slack hood.contact.offset hood.paths.EDC solve.tolerance "
    "extends finger.gravity finger.bones.distal.surface".split()
) | st.text(max_size=12)
PLAIN = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
WORDS = st.sampled_from(
    [
        "3 mm",
        "2 N",
        "pulley",
        "hinge",
        "file",
        "shell",
        "[]",
        "{}",
        "[[1]]",
        '["1 mm"]',
        "1979-05-27",
        "{kind='file', path='x'}",
        "[{body='distal', point=['1 mm', '2 mm', 3]}]",
        "1e400",
        "9" * 400,
    ]
)


@settings(max_examples=150)
@given(st.lists(st.tuples(KEYS, WORDS | PLAIN.map(str)), min_size=1, max_size=4))
def test_any_override_gives_a_case_or_an_input_error(pairs):
    try:
        case = load_case("isometric_edc", [f"{key}={value}" for key, value in pairs])
        assert isinstance(case, Case)
    except InputError as error:
        assert str(error)


LINES = st.tuples(KEYS, WORDS | st.text(max_size=12)).map(" = ".join) | st.text(max_size=20)


@settings(max_examples=150)
@given(st.lists(LINES, max_size=8).map("\n".join))
def test_any_file_gives_a_case_or_an_input_error(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_text(text, encoding="utf-8", errors="replace")
    try:
        assert isinstance(load_case(path), Case)
    except InputError as error:
        assert "any.toml" in str(error)


def test_the_json_schema_knows_every_table_and_requires_nothing():
    schema = json_schema()
    assert set(schema["properties"]) == {
        *("extends", "title", "notes", "finger", "tendons"),
        *("hood", "lesion", "gives_way", "relaxation", "solve", "forward", "coupling", "output"),
    }
    tables = [schema, *schema["$defs"].values()]
    assert all("required" not in table for table in tables)
    thickness = schema["$defs"]["ShellHoodConfig"]["properties"]["thickness"]
    assert thickness["type"] == "string"
    assert thickness["examples"] == ["0.6 mm"]
