"""OpenSim files made to harm: too much of anything, outer files, damage at random."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim.errors import InputError
from rigid.opensim import skeleton, xml
from rigid.opensim.osim import import_osim, write_import
from tests.helpers.osim_files import (
    TWO_POINTS,
    axis,
    body,
    coordinate,
    custom,
    import_text,
    joint,
    model,
    muscle,
)

LINEAR = "<LinearFunction><coefficients>{}</coefficients></LinearFunction>"
LIMIT = '<CoordinateLimitForce name="l"><coordinate>q</coordinate></CoordinateLimitForce>'


def test_a_million_elements_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond a limit below that, which is made small here."""
    assert xml.LIMITS.tags < 1_000_000
    monkeypatch.setattr(xml, "LIMITS", replace(xml.LIMITS, tags=1000))
    with pytest.raises(InputError, match="more than 1000 tags"):
        import_text(tmp_path, f"<OpenSimDocument>{'<a/>' * 1001}</OpenSimDocument>")


def test_more_bodies_than_fit_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bodies = "".join(body(f"b{k}") for k in range(4))
    chain = "".join(
        joint(f"j{k}", f"/bodyset/b{k - 1}" if k else "/ground", f"b{k}", coordinate(f"q{k}"))
        for k in range(4)
    )
    assert len(import_text(tmp_path, model(bodies, chain)).coordinates) == 4
    monkeypatch.setattr(skeleton, "MOST_IN_CHAIN", 3)
    with pytest.raises(InputError, match='"b3": more than 3 bodies hang from one another'):
        import_text(tmp_path, model(bodies, chain))
    monkeypatch.setattr(skeleton, "MOST_BODIES", 3)
    with pytest.raises(InputError, match="more than 3 bodies"):
        import_text(tmp_path, model(bodies, ""))


def test_a_long_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xml, "LIMITS", replace(xml.LIMITS, bytes=1000))
    with pytest.raises(InputError, match="the most that is read"):
        import_text(tmp_path, model() + " " * 1000)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.osim"
    path.write_bytes(b"<OpenSimDocument>\n\xff</OpenSimDocument>")
    with pytest.raises(InputError, match="line 2: not UTF-8"):
        import_osim(path)


def test_files_that_cannot_be_read_or_written_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        import_osim(tmp_path / "none.osim")
    made = import_text(tmp_path, model())
    (tmp_path / "none").touch()
    with pytest.raises(InputError, match="cannot be written"):
        write_import(made, tmp_path / "none" / "out.xml")
    for name in ("model.osim", "out.json"):
        with pytest.raises(InputError, match=r"must end in \.xml"):
            write_import(made, tmp_path / name)


def test_an_entity_of_an_outer_file_is_not_opened(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("9.81")
    text = f'<!DOCTYPE m [<!ENTITY s SYSTEM "{secret}">]>' + model(rest="<gravity>&s;</gravity>")
    with pytest.raises(InputError, match="entities"):
        import_text(tmp_path, text.replace('<?xml version="1.0" encoding="UTF-8"?>', ""))


WHOLE = model(
    forces=muscle("mus", TWO_POINTS) + LIMIT,
    joints=custom(
        axis("rotation1", LINEAR.format("1 0.1"), "q"),
        axis("translation2", "<Constant><value>0.1</value></Constant>"),
        coordinates=coordinate("q", "<range>-1 1</range>"),
    ),
)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    start=st.integers(0, len(WHOLE)),
    cut=st.integers(0, 60),
    put=st.text(st.sampled_from("<>/&;\"'=:- ab01.eN\n"), max_size=12),
)
def test_a_damaged_file_is_imported_or_refused_in_one_message(
    start: int, cut: int, put: str, tmp_path: Path
) -> None:
    text = WHOLE[:start] + put + WHOLE[start + cut :]
    try:
        made = import_text(tmp_path, text)
    except InputError as error:
        assert "model.osim" in str(error)
    else:
        assert made.xml.startswith("<mujoco")
