"""`hood.regions.all`: what it gives to the regions, and what comes on top of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cosim.case.file import load_case, packaged_cases, resolved_toml
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.hoods.shell.table import LAWS, region_keys
from meshes.hood_mesh import REGIONS

ALL = '[hood.regions.all]\nkind = "neo_hookean"\nmodulus = "80 MPa"\npoisson = 0.3\n'


def case_of(folder: Path, text: str, *settings: str, base: str = "base/one_sheet.toml") -> Case:
    path = folder / "mine.toml"
    path.write_text(f'extends = "{base}"\ntitle = "mine"\n{text}', encoding="utf-8")
    return load_case(path, settings)


def regions(case: Case) -> dict[str, Any]:
    hood: Any = case.hood
    return hood.regions


def test_every_region_has_it_over_what_the_base_says(tmp_path):
    found = regions(case_of(tmp_path, ALL))
    assert set(found) == set(REGIONS) - {"triangular_ligament"}
    assert {(r.kind, r.modulus, r.poisson) for r in found.values()} == {("neo_hookean", 80e6, 0.3)}


def test_a_region_of_the_same_file_comes_on_top_key_by_key(tmp_path):
    own = '[hood.regions.central_slip]\nmodulus = "150 MPa"\n'
    for text in (ALL + own, own + ALL):
        found = regions(case_of(tmp_path, text))
        assert (found["central_slip"].modulus, found["central_slip"].poisson) == (150e6, 0.3)
        assert found["central_band"].modulus == 80e6


def test_a_region_of_another_law_replaces_it(tmp_path):
    own = '[hood.regions.central_slip]\nkind = "isotropic"\nmodulus = "9 MPa"\npoisson = 0.1\n'
    found = regions(case_of(tmp_path, ALL + own))
    assert (found["central_slip"].kind, found["terminal_slip"].kind) == ("isotropic", "neo_hookean")


LAW_NUMBERS: dict[str, str] = {
    "isotropic": 'modulus = "9 MPa", poisson = 0.3',
    "neo_hookean": 'modulus = "9 MPa", poisson = 0.3',
    "transversely_isotropic": 'modulus_along = "90 MPa", modulus_across = "9 MPa", '
    'shear_modulus = "4.5 MPa", poisson = 0.4, poisson_across = 0.4',
    "trans_iso_mooney_rivlin": 'c1 = "1 MPa", c2 = "0 MPa", c3 = "0.005 MPa", c4 = 400.0, '
    'c5 = "90 MPa", lam_max = 1.01',
    "holzapfel_gasser_ogden": 'c = "2 MPa", k1 = "12 MPa", k2 = 50.0, dispersion = 0.05, '
    'angle = "10 deg"',
}
OWN = {"tension_field": "true", "direction": '{ angle = "7 deg" }', "in_situ_stretch": "1.01"}


@pytest.mark.parametrize("size", ['section = "1.3 mm**2"', 'thickness = "0.3 mm"'])
@pytest.mark.parametrize("new", LAWS)
@pytest.mark.parametrize("old", LAWS)
def test_a_change_of_law_keeps_what_is_the_region_s(tmp_path, old, new, size):
    own = {key: text for key, text in OWN.items() if key in region_keys(old)}
    stated = ", ".join([size, *(f"{key} = {text}" for key, text in own.items())])
    settings = [f"hood.regions.all={{ kind = '{old}', {LAW_NUMBERS[old]}, {stated} }}"]
    before = regions(case_of(tmp_path, "", *settings))
    settings.append(f"hood.regions.all={{ kind = '{new}', {LAW_NUMBERS[new]} }}")
    after = case_of(tmp_path, "", *settings)
    for name, region in regions(after).items():
        assert region.kind == new
        for key in {"thickness", "section", *own} & set(region_keys(new)):
            assert getattr(region, key) == getattr(before[name], key)
    lost = {"direction", "in_situ_stretch"} & {*own} - {*region_keys(new)}
    assert all(key in " ".join(after.dropped) for key in lost)
    assert bool(after.dropped) == bool(lost)


def test_no_region_of_the_shipped_hood_loses_its_size(tmp_path):
    before = regions(load_case("base/index_finger.toml"))
    for law in LAWS:
        text = f"hood.regions.all={{ kind = '{law}', {LAW_NUMBERS[law]} }}"
        after = regions(case_of(tmp_path, "", text, base="base/index_finger.toml"))
        sizes = [(r.thickness, r.section) for r in before.values()]
        assert [(r.thickness, r.section) for r in after.values()] == sizes


def test_directions_of_two_families_stay_together_or_go_together(tmp_path):
    slip = "hood.regions.lateral_slip_radial"
    one = "{ kind = 'holzapfel_gasser_ogden', c = '1 MPa', k1 = '5 MPa', k2 = 3.0, dispersion = 0.0"
    change = f"{slip}={one}, angle = '5 deg' }}"
    case = case_of(tmp_path, "", change, base="base/index_finger.toml")
    assert regions(case)["lateral_slip_radial"].direction is None
    assert case.dropped == (
        "hood.regions: another law drops direction, second of lateral_slip_radial",
    )
    family = "second = { k1 = '5 MPa', k2 = 3.0, dispersion = 0.0 }"
    case = case_of(tmp_path, "", f"{slip}={one}, {family} }}", base="base/index_finger.toml")
    both = regions(case)["lateral_slip_radial"]
    assert (both.direction.angle, both.second.direction.angle) == pytest.approx(
        (0.29671, -0.29671), abs=1e-5
    )
    assert case.dropped == ()


def test_a_section_takes_the_place_of_a_thickness_below_it(tmp_path):
    sizes = 'hood.regions.all.thickness="0.2 mm"', 'hood.regions.central_slip.section="1.1 mm**2"'
    slip = regions(case_of(tmp_path, "", *sizes))["central_slip"]
    assert (slip.thickness, slip.section) == (None, pytest.approx(1.1e-6))


def test_the_hood_says_which_regions_follow_its_thickness():
    case = load_case("base/index_finger.toml")
    says = case.hood.followers()["hood.thickness"]
    assert "oblique_fibres_radial" in says
    assert "central_slip" not in says
    whole = load_case("base/one_sheet.toml")
    assert whole.hood.followers() == {"hood.thickness": "acts on every region"}


def test_a_part_of_it_leaves_the_rest_of_each_region(tmp_path):
    before = regions(load_case("base/index_finger.toml"))
    text = "[hood.regions.all]\ntension_field = true\n"
    found = regions(case_of(tmp_path, text, base="base/index_finger.toml"))
    assert all(region.tension_field for region in found.values())
    for name, region in found.items():
        assert region.model_copy(update={"tension_field": False}) == before[name]


def test_a_setting_is_over_the_file_and_a_later_file_over_the_one_before(tmp_path):
    own = '[hood.regions.central_slip]\nmodulus = "150 MPa"\n'
    found = regions(case_of(tmp_path, ALL + own, 'hood.regions.all.modulus="7 MPa"'))
    assert {region.modulus for region in found.values()} == {7e6}
    found = regions(case_of(tmp_path, ALL, 'hood.regions.central_slip.modulus="7 MPa"'))
    assert found["central_slip"].modulus == 7e6
    assert found["central_slip"].poisson == 0.3
    replaced = case_of(tmp_path, ALL).replace({"hood.regions.all.poisson": 0.2})
    assert {region.poisson for region in regions(replaced).values()} == {0.2}


def test_without_a_base_it_names_all_regions_of_the_layout(tmp_path):
    for layout, lacks in (("anatomical", set()), ("one_sheet", {"triangular_ligament"})):
        case = load_case("base/one_sheet.toml")
        table = case.model_dump(mode="json", exclude={"name", "source"}, exclude_none=True)
        table["hood"]["mesh"]["layout"] = layout
        table["hood"]["regions"] = {"all": table["hood"]["regions"]["central_slip"]}
        found = Case.from_layers([("here", table)], tmp_path / "mine.toml")
        assert set(regions(found)) == set(REGIONS) - lacks


def test_the_resolved_case_names_each_region(tmp_path):
    case = case_of(tmp_path, ALL)
    text = resolved_toml(case)
    assert "regions.all" not in text
    again = tmp_path / "again.toml"
    again.write_text(text, encoding="utf-8")
    assert load_case(again).hood == case.hood


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        ('hood.regions.all.modulus="5 mm"', "hood.regions.all.modulus = '5 mm'"),
        ('hood.regions.all.kind="holzapfel_gasser_ogden"', "hood.regions.all.k1: is missing"),
        ("hood.regions.all.modulos=1", "hood.regions.all.modulos = 1"),
        ("hood.regions.all=3", "regions.all: must be a table"),
    ],
)
def test_a_fault_in_it_is_told_once_where_it_stands(tmp_path, setting, line):
    with pytest.raises(InputError) as caught:
        case_of(tmp_path, ALL, setting)
    assert str(caught.value).count(line) == 1
    assert "central_slip:" not in str(caught.value)


def test_every_law_has_a_shipped_case():
    """Each is run by the golden numbers, which hold it to its audit."""
    hoods = [load_case(name).hood for name in packaged_cases()]
    unused = [law for law in LAWS if not any(hood.laws(law) for hood in hoods)]
    assert unused == []
