"""A stranger's FMU: hostile archives are refused with one message, and nothing of them unpacked."""

from __future__ import annotations

import re
import stat
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.case.file import load_case
from cosim.errors import InputError, ReadingWarning
from cosim.fmu import archive
from cosim.fmu.archive import unpack_fmu
from cosim.fmu.mapping import VariablePlace, places
from cosim.fmu.quantity import hood_quantities
from cosim.fmu.unit import Unit
from cosim.fmu_export.run import part_of
from cosim.fmu_export.write import write_fmu
from tests.helpers.fmus import NEEDS_FMU, change_archive, change_description

pytestmark = NEEDS_FMU
XML = "modelDescription.xml"
BOMB = (
    b'<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a "lol"><!ENTITY b "&a;&a;&a;">]>'
    b'<fmiModelDescription fmiVersion="2.0">&b;</fmiModelDescription>'
)
OUTSIDE = (
    b'<?xml version="1.0"?><!DOCTYPE d [<!ENTITY a SYSTEM "file:///etc/hostname">]>'
    b'<fmiModelDescription fmiVersion="2.0" modelName="&a;"/>'
)


@pytest.fixture(scope="module")
def hood(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("fmu") / "hood.fmu"
    write_fmu(load_case("pulley_edc"), "hood", 2, path)
    return path


@pytest.fixture(scope="module")
def hood3(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("fmu") / "hood3.fmu"
    write_fmu(load_case("pulley_edc"), "hood", 3, path)
    return path


def check_refusal(path: Path, words: str, folder: Path) -> None:
    room = folder / "room"
    room.mkdir()
    with pytest.raises(InputError, match=words) as error:
        unpack_fmu(path, room)
    assert str(path) in str(error.value)
    assert not list(room.iterdir())


def link(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name)
    entry.create_system, entry.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
    return entry


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("../outside.txt", "outside of its folder"),
        ("resources/../../outside.txt", "outside of its folder"),
        ("/tmp/outside.txt", "outside of its folder"),
        ("..\\outside.txt", "outside of its folder"),
        ("C:outside.txt", "outside of its folder"),
        (link("resources/link"), "is a link or a device"),
    ],
)
def test_a_path_that_leaves_the_archive(hood, tmp_path, name, words):
    check_refusal(change_archive(hood, tmp_path / "evil.fmu", more={name: b"x"}), words, tmp_path)


def test_the_same_name_twice(hood, tmp_path):
    with pytest.warns(UserWarning, match="Duplicate name"):
        path = change_archive(hood, tmp_path / "twice.fmu", more={XML: b"<a/>"})
    check_refusal(path, "more than once", tmp_path)


def test_two_names_that_are_one_where_case_does_not_count(hood, tmp_path):
    path = change_archive(hood, tmp_path / "twice.fmu", more={XML.upper(): b"<a/>"})
    check_refusal(path, "more than once", tmp_path)


def test_more_than_it_may_unpack_to(hood, tmp_path, monkeypatch):
    big = zipfile.ZipInfo("resources/zeros")
    big.compress_type = zipfile.ZIP_DEFLATED
    path = change_archive(hood, tmp_path / "bomb.fmu", more={big: bytes(2**24)})
    monkeypatch.setattr(archive, "MOST_BYTES", 2**23)
    check_refusal(path, "expected at most 20000 of 8 MiB", tmp_path)


def test_more_files_than_it_may_hold(hood, tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MOST_FILES", 3)
    check_refusal(hood, "expected at most 3 of", tmp_path)


def test_a_size_that_the_archive_lies_about(hood, tmp_path):
    """The central directory says 1 byte; zipfile reads no further and finds the checksum wrong."""
    path = change_archive(hood, tmp_path / "lie.fmu", more={"resources/lie": b"lie" * 1000})
    data = path.read_bytes()
    at = data.rindex(b"PK\x01\x02", 0, data.rindex(b"resources/lie"))
    path.write_bytes(data[: at + 24] + (1).to_bytes(4, "little") + data[at + 28 :])
    with pytest.raises(InputError, match="cannot be read as an FMU"):
        unpack_fmu(path, tmp_path / "room")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"<fmiModelDescription", "not well-formed"),
        (b"", "not well-formed"),
        (b'<?xml version="1.0" encoding="UZF-8"?><a/>', "not well-formed .*encoding"),
        (b'<?xml version="1.0" encoding="shift-jis"?><a/>', "not well-formed .*encoding"),
        (BOMB, "document type or entities"),
        (OUTSIDE, "document type or entities"),
        (b'<fmiModelDescription fmiVersion="1.0"/>', "fmiVersion '1.0'"),
        (b"<html/>", "is a <html>"),
    ],
)
def test_a_bad_description(hood, tmp_path, text, words):
    check_refusal(
        change_archive(hood, tmp_path / "bad.fmu", {XML: lambda old: text}), words, tmp_path
    )


def test_no_description(hood, tmp_path):
    path = change_archive(hood, tmp_path / "none.fmu", without=(XML,))
    check_refusal(path, "is no FMU: it has no modelDescription.xml", tmp_path)


def test_a_description_that_breaks_the_schema(hood, tmp_path):
    path = change_description(hood, tmp_path / "odd.fmu", "valueReference=", "valueReferenz=")
    with pytest.raises(InputError, match="is not valid"):
        unpack_fmu(path, tmp_path / "room")


SMALL_FAULTS = {
    "an attribute of another element": ("<fmiModelDescription ", '<fmiModelDescription canX="1" '),
    "an unknown attribute": ("<CoSimulation ", '<CoSimulation stepSize="0.001" '),
    "no GUID": (r'guid="[^"]*"', ""),
    "no ModelStructure": (r"(?s)<ModelStructure>.*</ModelStructure>", ""),
    "an output that is not there": (r'<Unknown index="\d+"', '<Unknown index="99999"'),
    "parts in another order": (
        r"(?s)(<ModelVariables>.*</ModelVariables>)\s*(<ModelStructure>.*</ModelStructure>)",
        r"\2\1",
    ),
    "an unknown causality": (
        "</ModelVariables>",
        '<ScalarVariable name="odd" valueReference="99999" causality="none"><Real/>'
        "</ScalarVariable></ModelVariables>",
    ),
    "a constant parameter": (
        "</ModelVariables>",
        '<ScalarVariable name="odd" valueReference="99999" causality="parameter" '
        'variability="constant"><Real start="1"/></ScalarVariable></ModelVariables>',
    ),
    "a continuous switch": (
        "</ModelVariables>",
        '<ScalarVariable name="odd" valueReference="99999"><Boolean/></ScalarVariable>'
        "</ModelVariables>",
    ),
    "a variable without type": (
        "</ModelVariables>",
        '<ScalarVariable name="odd" valueReference="99999"/></ModelVariables>',
    ),
    "a derivative of none": (
        "</ModelVariables>",
        '<ScalarVariable name="odd" valueReference="99999"><Real derivative="77777"/>'
        "</ScalarVariable></ModelVariables>",
    ),
    "an unknown type": (
        "</ModelVariables>",
        '<ScalarVariable name="odd" valueReference="99999"><Real declaredType="None"/>'
        "</ScalarVariable></ModelVariables>",
    ),
    "a unit that is not defined": (
        "</ModelVariables>",
        '<ScalarVariable name="odd" valueReference="99999"><Real unit="furlong"/>'
        "</ScalarVariable></ModelVariables>",
    ),
    "an attribute of a type": (
        "<ModelVariables>",
        '<TypeDefinitions><SimpleType name="T"><Real odd="1"/></SimpleType></TypeDefinitions>'
        "<ModelVariables>",
    ),
}


@pytest.mark.parametrize("fault", SMALL_FAULTS)
def test_a_small_fault_that_others_load_is_a_warning(hood, tmp_path, fault):
    old, new = SMALL_FAULTS[fault]

    def spoil(text: bytes) -> bytes:
        changed, count = re.subn(old, new, text.decode(), count=1)
        assert count
        return changed.encode()

    path = change_archive(hood, tmp_path / "odd.fmu", {XML: spoil})
    with pytest.warns(ReadingWarning, match=r"odd\.fmu: .* breaks the standard .*strict = true"):
        found = unpack_fmu(path, tmp_path / "room")
    places(found, part_of(load_case("pulley_edc"), "hood").quantities, {})
    assert found.rolls_back
    with pytest.raises(InputError, match=r"is not valid: .*; leave out strict = true"):
        unpack_fmu(path, tmp_path / "strict", strict=True)


def test_small_faults_of_fmi_3_are_a_warning_too(hood3, tmp_path):
    new = '<VendorAnnotations/><ModelVariables odd="1">'
    path = change_description(hood3, tmp_path / "odd3.fmu", "<ModelVariables>", new)
    with pytest.warns(ReadingWarning, match="VendorAnnotations"):
        found = unpack_fmu(path, tmp_path / "room")
    places(found, part_of(load_case("pulley_edc"), "hood").quantities, {})


def test_two_variables_of_one_name_are_refused(hood, tmp_path):
    path = change_description(hood, tmp_path / "two.fmu", '"tension.EI"', '"tension.EDC"')
    with pytest.raises(InputError, match=r'is not valid: .*"tension\.EDC".* is not unique'):
        unpack_fmu(path, tmp_path / "room")


def describe(folder: Path, content: bytes) -> Path:
    """An archive with that content among the variables of its description."""
    path = folder / "large.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        start = b'<fmiModelDescription fmiVersion="2.0"><ModelVariables>'
        new.writestr(XML, start + content + b"</ModelVariables></fmiModelDescription>")
    return path


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"<a/>" * 2_000_000, "more than 1,000,000 tags and attributes"),
        (b"<a " + b'b="" ' * 400_000 + b"/>", "longer than 1 MiB|not well-formed"),
        (b"<a b='" + b"x" * 2**21 + b"'/>", "longer than 1 MiB"),
        (b"<!--" + b"x" * 2**21 + b"-->", "longer than 1 MiB"),
        (b"x" * 2**24, "not well-formed|is not valid"),
    ],
)
def test_a_description_out_of_all_measure_is_refused_before_a_tree_is_made(
    tmp_path, content, words
):
    path = describe(tmp_path, content)
    del content
    tracemalloc.start()
    check_refusal(path, words, tmp_path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100e6


def packed(hood: Path, path: Path, method: int) -> bytearray:
    """The bytes of an archive of one long file, packed by a method."""
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr("resources/data", bytes(range(256)) * 200)
        archive.writestr(XML, zipfile.ZipFile(hood).read(XML))
    return bytearray(path.read_bytes())


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_fault_in_a_packed_file_is_refused_whatever_packed_it(hood, tmp_path, method):
    path = tmp_path / "packed.fmu"
    whole, rng, refused = packed(hood, path, method), np.random.default_rng(1), 0
    for i in range(60):
        spoilt = whole.copy()
        spoilt[int(rng.integers(0, len(whole)))] ^= int(rng.integers(1, 256))
        path.write_bytes(spoilt)
        with pytest.raises(InputError) as error:  # at the latest as there is no binary
            unpack_fmu(path, tmp_path / f"room{i}")
        refused += "cannot be read as an FMU" in str(error.value)
    assert refused > 5


def test_no_archive_at_all(tmp_path):
    path = tmp_path / "text.fmu"
    path.write_text("not a zip")
    check_refusal(path, "cannot be read as an FMU", tmp_path)


def test_an_encrypted_file(hood, tmp_path):
    path = tmp_path / "secret.fmu"
    data = hood.read_bytes()
    at = data.rindex(b"PK\x01\x02")
    path.write_bytes(data[: at + 8] + b"\x01\x00" + data[at + 10 :])
    check_refusal(path, "is encrypted", tmp_path)


@pytest.mark.parametrize("fmi", [2, 3])
def test_another_platform(hood, hood3, tmp_path, fmi):
    path = tmp_path / "foreign.fmu"
    change_archive(
        (hood, hood3)[fmi - 2], path, without=("binaries/linux64", "binaries/x86_64-linux")
    )
    with pytest.raises(InputError, match=r"no binary for this machine, .*; it has (win|x86)"):
        unpack_fmu(path, tmp_path / "room")


def test_an_identifier_that_is_a_path(hood, tmp_path):
    old = 'modelIdentifier="cosim_hood"'
    path = change_description(hood, tmp_path / "id.fmu", old, 'modelIdentifier="../../cosim_hood"')
    with pytest.raises(InputError, match="is no name in the sense of C"):
        unpack_fmu(path, tmp_path / "room")


def test_what_a_unit_can_do_is_read(hood, hood3, tmp_path):
    for path in (hood, hood3):
        found = unpack_fmu(path, tmp_path / path.stem)
        assert found.rolls_back
        assert not found.differentiates
    old = "<CoSimulation "
    able = {2: 'providesDirectionalDerivative="true" ', 3: 'providesDirectionalDerivatives="1" '}
    for fmi, path in ((2, hood), (3, hood3)):
        new = change_description(path, tmp_path / f"able{fmi}.fmu", old, old + able[fmi])
        assert unpack_fmu(new, tmp_path / f"able{fmi}").differentiates


def map_unit(
    path: Path, names: dict[str, str], assume_si: bool = False
) -> dict[str, VariablePlace]:
    part = part_of(load_case("pulley_edc"), "hood")
    quantities = hood_quantities(part.hood.bodies, part.hood.sources, part.hood.tendons)
    return places(Unit(path).opened, quantities, names, (), assume_si)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ({"tension": "pull.{tendon}"}, r"no variable pull\.EDC, .*map\.tension names them"),
        ({"tension": "tensino.{tendon}"}, r"did you mean tension\.EDC\?"),
        ({"tension": "tension.{muscle}"}, r"it takes \{tendon\}, \{tendon_index\}"),
        ({"tension": "tension[{tendon_index}]"}, r"no variable tension\[1\], tension\[2\]"),
        ({"tension": "tension.EDC"}, r"tension\.EDC: holds 1 values, expected 4"),
        ({"velocity": "v"}, r"map\.velocity: no such quantity; known are position,"),
        ({"tension": "excursion.{tendon}"}, "causality is output, expected input"),
        ({"static": "tolerance"}, "is of type Real, expected Boolean"),
        ({"force": "moment.{body}.{source}.{axis}"}, r"is in N\.m, expected N"),
    ],
)
def test_names_that_do_not_map(hood, names, words):
    with pytest.raises(InputError, match=words):
        map_unit(hood, names)


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("new", "factor", "offset"),
    [
        ('<BaseUnit m="1" factor="0.001" />', 1e-3, 0.0),
        ('<BaseUnit m="1" factor="2" offset="0.5" />', 2.0, 0.5),
    ],
)
def test_a_unit_of_another_scale_is_read_by_the_files_own_factor(
    hood, hood3, tmp_path, fmi, new, factor, offset
):
    path = change_description(
        (hood, hood3)[fmi - 2], tmp_path / "scaled.fmu", '<BaseUnit m="1" />', new
    )
    place = map_unit(path, {})["excursion"]
    assert (place.factor == factor).all()
    assert (place.offset == offset).all()


@pytest.mark.parametrize(
    ("fmi", "stated"),
    [
        *((2, f'factor="{value}"') for value in ("0", "-0.0", "NaN", "INF", "1e31", "1e-320")),
        *((2, 'offset="NaN"'), (3, 'factor="0"'), (3, 'offset="-INF"')),
    ],
)
def test_a_unit_of_no_scale_is_refused(hood, hood3, tmp_path, fmi, stated):
    """With it every value would be zero, infinite or none."""
    path = change_description(
        *((hood, hood3)[fmi - 2], tmp_path / "u.fmu", '<BaseUnit m="1" />'),
        f'<BaseUnit m="1" {stated} />',
    )
    with pytest.raises(InputError, match=r"its unit 'm' has the factor .* not zero"):
        map_unit(path, {})


@pytest.mark.parametrize(
    ("old", "new", "name", "factor"),
    [
        ('<BaseUnit kg="1" m="2" s="-2" />', "", "moment", 1.0),
        ('kg="1" m="1" s="-2" />', 'kg="1" m="1" s="-2" factor="1e3" />', "force", 1e3),
    ],
)
def test_a_unit_without_a_base_is_read_by_its_name(hood, tmp_path, old, new, name, factor):
    path = change_description(hood, tmp_path / "named.fmu", old, new)
    assert (map_unit(path, {})[name].factor == factor).all()


def test_a_name_that_is_no_unit_of_the_quantity_is_refused(hood, tmp_path):
    old = '<BaseUnit kg="1" m="1" s="-2" />'
    path = change_description(hood, tmp_path / "odd.fmu", old, '<BaseUnit kg="1" m="2" s="-2" />')
    with pytest.raises(InputError, match="is in N, expected N"):
        map_unit(path, {})


def test_no_unit(hood, tmp_path):
    path = change_description(hood, tmp_path / "bare.fmu", ' unit="N"', "")
    with pytest.raises(InputError, match=r"states no unit, expected N; .*assume_si = true"):
        map_unit(path, {})
    map_unit(path, {}, assume_si=True)


@settings(max_examples=60)
@given(data=st.data())
def test_a_damaged_archive_is_refused_or_read(hood, tmp_path_factory, data):
    """Truncated or with some bytes changed: an InputError, or a unit that is as good as before."""
    whole = hood.read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    piece = data.draw(st.binary(max_size=8))
    cut = data.draw(st.booleans())
    folder = tmp_path_factory.mktemp("damaged")
    path = folder / "damaged.fmu"
    path.write_bytes(whole[:at] if cut else whole[:at] + piece + whole[at + len(piece) :])
    try:
        found = unpack_fmu(path, folder / "room")
    except InputError as error:
        assert str(path) in str(error)
    else:
        assert found.description.coSimulation.modelIdentifier == "cosim_hood"
