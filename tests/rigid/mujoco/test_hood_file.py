"""Hoods in plain MuJoCo: what is written pulls as what it was written from."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.analyses.mjcf_hood import attached_hood, hood_file
from cosim.case.file import load_case
from cosim.cli import app
from cosim.models.build import mjcf_of
from rigid.hoods.network import Arms, Network
from rigid.hoods.reduced import ReducedPotential
from rigid.mjcf.hood import (
    FOLLOWER,
    Band,
    Follower,
    HeldModel,
    HoodParts,
    add_hood,
    compile_model,
    network_parts,
)
from rigid.mjcf.reduced import Lengths, Ridge, _first_bands, _Fit, _move, _parts, states_of

JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")
STEP = 2e-3


def bare_root() -> ET.Element:
    """The index finger without a hood, as elements."""
    root = ET.fromstring(mjcf_of(load_case("network_edc")))
    root.remove(root.find("keyframe"))
    return root


@pytest.mark.parametrize("name", ["network_edc", "two_band_edc"])
def test_a_network_in_the_file_pulls_as_behind_the_port(name):
    made = hood_file(load_case(name), "network", states=9)
    found = {e.quantity: e.most for e in made.errors}
    # Excursions differ by the MCP's angle in abduction: there of the turn, here of the hinge.
    assert found.pop("excursion, of its range") < 0.02
    assert max(found.values()) < 1e-3
    assert not made.doubts
    assert "presses no bones together" in made.text
    mujoco.MjModel.from_xml_string(made.text)


def test_the_file_begins_at_rest_and_stays_so_at_2_ms():
    made = hood_file(load_case("network_edc"), "network", states=3)
    model = mujoco.MjModel.from_xml_string(made.xml)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    junctions = [model.joint(name).qposadr[0] for name in made.parts.junctions]
    before = data.qpos[junctions].copy()
    model.opt.timestep = STEP
    mujoco.mj_step(model, data)
    assert data.qpos[junctions] == pytest.approx(before, abs=2e-6)
    data.ctrl[model.actuator("EDC").id] = 30.0  # at once
    data.ctrl[model.actuator("FDP").id] = 20.0
    mujoco.mj_step(model, data, nstep=1000)
    assert np.abs(data.qvel).max() < 1e-6
    taken = sum(data.sensor(n).data[0] for n in ("edc_slip", "edc_ulnar", "edc_radial"))
    assert taken == pytest.approx(30.0, rel=1e-3)


def test_a_follower_of_a_sum_makes_a_product_of_two_angles():
    """2 x y = (x + y)^2 - x^2 - y^2."""
    square = (0.0, 0.0, 1.0, 0.0, 0.0)
    followers = {
        "both": Follower({"MCP": 1.0, "PIP": 1.0}, square),
        "one": Follower({"MCP": 1.0}, square),
        "other": Follower({"PIP": 1.0}, square),
    }
    weights = {"J": 1.0, "both": -2e-3, "one": 2e-3, "other": 2e-3}
    parts = HoodParts({"M": {"J": -1.0}}, ("J",), {"b": Band(weights, 0.0, 5e4)}, followers)
    held = HeldModel(compile_model(add_hood(bare_root(), parts)), JOINTS, parts)
    for x, y in ((0.3, 0.8), (1.0, 0.2), (-0.3, 1.4)):
        held.settle(np.array([x, 0.1, y, 0.2]), {"M": 10.0})
        arms = 1e-3 * 4 * np.array([y, 0.0, x, 0.0])  # of the length 4 mm x y
        assert held.torque() == pytest.approx(10.0 * arms, abs=1e-5)
        assert held.tensions()["b"] == pytest.approx(10.0, rel=1e-6)
        assert held.excursion() == pytest.approx([4e-3 * x * y + 10.0 / 5e4], abs=1e-6)


def test_a_slack_tendon_bears_nothing_and_stiffness_is_as_stated():
    arms = Arms(np.array([[-8e-3, -2e-3]]), np.zeros((1, 2)))
    none = Arms(np.zeros((1, 1)), np.zeros((1, 1)))
    rest = np.array([0.0, 0.2e-3])
    network = Network(("PIP",), ("M",), none, arms, np.array([2e4, 7e4]), np.ones((2, 1)), rest)
    parts = network_parts(network, ("a", "b"))
    held = HeldModel(compile_model(add_hood(bare_root(), parts)), JOINTS, parts)
    for angle, force in ((0.0, 3.0), (0.0, 40.0), (0.02, 15.0), (0.5, 15.0)):
        held.settle(np.array([0.0, 0.0, angle, 0.0]), {"M": force})
        _, tension = network.solve(np.array([angle]), np.array([force]))
        assert list(held.tensions().values()) == pytest.approx(tension, abs=1e-4 * force)


def a_potential() -> ReducedPotential:
    """Two joints, two muscles: arms that bend with both angles, stretch, and sharing."""
    terms = np.array([[0, 0], [1, 0], [2, 0], [0, 1], [0, 2], [1, 1]])
    powers = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [2, 0]])
    energy = np.zeros((5, 6))
    energy[:, 1] = [0.0, -6e-3, -3e-3, 4e-4, 2e-4]
    energy[:, 3] = [0.0, 4e-3, -2e-3, -3e-4, 1e-4]
    energy[0, [2, 4]] = 2e-3
    energy[1, 5] = 2e-5
    return ReducedPotential(
        ("MCP", "PIP"),
        ("EDC", "LUM"),
        np.array([0.0, 0.2]),
        np.array([0.8, 1.0]),
        np.array([4.0, 3.0]),
        powers,
        terms,
        0.03,
        energy,
        np.zeros((1, 2), dtype=int),
        np.zeros((2, 1, 3)),
    )


def a_fit(count: int = 60) -> tuple[Lengths, _Fit, ReducedPotential]:
    potential, random = a_potential(), np.random.default_rng(0)
    basis = Lengths(potential, (Ridge(np.array([1.0, 0.0]), 2), Ridge(np.array([1.0, 1.0]), 2)))
    angle = random.uniform(potential.low, potential.high, (count, 2))
    load = random.uniform(0.1, 1.0, (count, 2)) * potential.most
    maps = np.tile(np.eye(3)[:, :2] * 20.0, (count, 1, 1))
    return basis, _Fit(basis, states_of(potential, angle, load), maps), potential


def test_derivatives_of_the_fit_are_those_of_its_equilibrium():
    basis, fit, potential = a_fit(12)
    bands = _first_bands(potential, fit._data, basis)
    at = fit._answer(bands, fit._data.excursion)
    slopes, left = fit._slopes(bands, at), fit._left(at)
    random = np.random.default_rng(1)
    for _ in range(3):
        step = 1e-7 * random.normal(size=slopes.shape[1])
        step[bands.lengths.size :] *= 1e3
        moved = fit._left(fit._answer(_move(bands, step), at.junction))
        assert moved - left == pytest.approx(slopes @ step, rel=2e-3, abs=2e-7)


def test_bands_come_near_to_a_reduced_hood_in_mujoco():
    basis, fit, potential = a_fit()
    bands = fit.solve(_first_bands(potential, fit._data, basis))
    parts = _parts(potential, basis, bands)
    held = HeldModel(compile_model(add_hood(bare_root(), parts)), JOINTS, parts)
    data = fit._data
    for k in range(5):
        held.settle(
            np.array([data.angle[k, 0], 0.0, data.angle[k, 1], 0.3]),
            dict(zip(potential.muscles, map(float, data.tension[k]), strict=True)),
        )
        off = np.linalg.norm(held.torque()[[0, 2]] - data.torque[k])
        assert off < 0.02 * np.linalg.norm(data.torque[k])


def stand_in(folder: Path) -> Path:
    """A small hand: the index finger with an extensor in fixed shares, and a keyframe."""
    path = folder / "hand.xml"
    path.write_text(mjcf_of(load_case("split_edc")), encoding="utf-8")
    return path


def test_an_attached_hood_pulls_as_the_network(tmp_path):
    hand, out = stand_in(tmp_path), tmp_path / "out" / "hooded.xml"
    least = 1e-4  # kg, the mass that MuJoCo gives at least here, as in MyoSuite's hand
    text = hand.read_text(encoding="utf-8").replace("<compiler", f'<compiler boundmass="{least}"')
    hand.write_text(text, encoding="utf-8")
    out.parent.mkdir()
    done = CliRunner().invoke(app, ["export", "--attach", str(hand), "-o", str(out)])
    assert done.exit_code == 0, done.output
    for words in ("EDC ends at a junction", "kept: EI", "arms in abduction", "no bones together"):
        assert words in " ".join(done.output.split())
    model = mujoco.MjModel.from_xml_path(str(out))
    assert model.key("posture").qpos.shape == (model.nq,)
    names = [model.joint(i).name for i in range(model.njnt)]
    junctions = tuple(n for n in names if n.endswith("_junction"))
    assert model.body("index_hood_PIP_square").mass == least
    power = (0.0, 0.0, (FOLLOWER / least) ** 0.5, 0.0, 0.0)
    square = {"index_hood_PIP_square": Follower({"PIP": 1.0}, power)}
    tendons = [model.tendon(i).name for i in range(model.ntendon)]
    bands = {n: Band({}, 0.0, 1.0) for n in tendons if n.startswith("index_hood_")}
    held = HeldModel(model, JOINTS, HoodParts({}, junctions, bands, square))
    network = hood_network()
    for angles, loads in (((0.4, 0.7, 0.2), (9.0, 3.0, 0.5)), ((0.9, 0.2, 0.5), (0.5, 6.0, 8.0))):
        held.settle(
            np.array([angles[0], 0.0, *angles[1:]]),
            dict(zip(("EDC", "LUM", "FPI"), loads, strict=True)),
        )
        torque = held.torque()[[0, 2, 3]]
        assert torque == pytest.approx(network.torque(np.array(angles), np.array(loads)), abs=1e-4)
    note = attached_hood(out, "index")
    assert note is not None
    assert note["hood"]["kind"] == "network"
    assert attached_hood(hand, "index") is None
    again = CliRunner().invoke(app, ["export", "--attach", str(out), "-o", str(tmp_path / "x.xml")])
    assert again.exit_code == 2
    assert "has a hood on this finger" in " ".join(again.output.split())


def hood_network() -> Network:
    from cosim.hoods.lumped.build import _network

    return _network(load_case("network_edc").hood)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "CASE is missing"),
        (["cable_edc", "--hood", "network"], "cosim export cable_edc -o reduced.toml"),
        (["cable_edc", "--hood", "cable"], "'network', 'reduced'"),
        (
            ["network_edc", "--finger", "middle"],
            "--finger: does not go with .xml, only with --attach",
        ),
        (["network_edc", "--names", "n.toml"], "--names: does not go with .xml"),
        (["--attach", "HAND", "-o", "HAND"], "is the hand itself"),
        (["--attach", "HAND", "--names", "n.toml"], 'n.toml: EDC = "EDCI": HAND has no'),
        (["network_edc", "--hood", "reduced"], "write --hood network"),
        (["split_edc", "--hood", "network"], "has another hood"),
        (["--attach", "none.xml"], "none.xml"),
        (["--attach", "HAND", "--finger", "middle"], "middle finger"),
        (
            ["network_edc", "--hood", "network", "--set", 'hood.operating_force="1 N"'],
            "hood.operating_force",
        ),
    ],
)
def test_what_cannot_be_written_is_refused_in_one_message(tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    hand = stand_in(tmp_path)
    (tmp_path / "n.toml").write_text('EDC = "EDCI"\n', encoding="utf-8")
    before = hand.read_bytes()
    if "-o" not in words:
        words = [*words, "-o", "hood.xml"]
    done = CliRunner().invoke(app, ["export", *(str(hand) if w == "HAND" else w for w in words)])
    assert done.exit_code == 2
    assert said in " ".join(done.output.replace("│", " ").split()).replace(str(hand), "HAND")
    assert hand.read_bytes() == before
    assert not list(tmp_path.glob("*hood*"))


def test_the_first_lines_name_motors_as_left_out():
    text = mjcf_of(load_case("robot_motor_flexor"))
    assert "dip_flexor: the motor that pulls it is left out" in text.partition("<option")[0]
