"""The public face: its names, that it stays light, and what each does."""

from __future__ import annotations

import os
import pickle
import pkgutil
import re
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest
from matplotlib import pyplot as plt

import cosim
from cosim.models.build import build
from cosim.port import AXES
from tests.helpers.fixed_posture import HELD
from tests.helpers.folders import ROOT

PLAIN = {"output.picture": False}
COARSE = {"hood.mesh.quads": 120}


def python(code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return done.stdout


def test_the_names_are_there_and_none_is_a_submodule():
    for name in cosim.__all__:
        assert getattr(cosim, name) is not None
    assert not {m.name for m in pkgutil.iter_modules(cosim.__path__)} & set(cosim.__all__)
    assert set(cosim.__all__) <= set(dir(cosim))
    with pytest.raises(AttributeError, match="no attribute 'rum'"):
        cosim.rum  # noqa: B018


def test_the_guide_has_a_line_for_every_name():
    guide = (ROOT / "cosim" / "README.md").read_text(encoding="utf-8")
    table = guide.partition("| name | what it does |")[2].partition("\n\n")[0]
    named = set(re.findall(r"`(\w+)(?:\.\w+)?`", table))
    assert set(cosim.__all__) - {"__version__", "Result"} <= named
    shown = guide.partition("A `Result` has")[2].partition("\n\n")[0]
    public = {name for name in vars(cosim.Result) if not name.startswith("_")}
    fields = {"name", "folder", "comparison", "picture"}
    assert {f"`{name}" for name in public - fields} <= set(re.findall(r"`\w+", shown))


def test_every_name_can_still_be_called_once_all_is_imported():
    for module in pkgutil.walk_packages(cosim.__path__, "cosim."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    for name in set(cosim.__all__) - {"__version__"}:
        assert callable(getattr(cosim, name)), name


def test_importing_it_and_checking_a_case_load_nothing_heavy():
    heavy = {"mujoco", "numba", "xarray", "matplotlib", "scipy", "pandas", "pyvista"}
    loaded = set(python("import cosim, sys; print(*sys.modules)").split())
    assert not loaded & {*heavy, "pydantic", "typer", "numpy"}
    check = "from cosim.cli import app; app(['check', 'pulley_edc'], standalone_mode=False)"
    said = python(f"import sys\n{check}\nprint(*sys.modules)")
    assert "in order" in said
    assert not set(said.split()) & {"mujoco", "numba", "xarray", "matplotlib"}


def test_a_run_loads_nothing_that_only_reading_needs(tmp_path):
    run = f"app(['run', 'split_edc', '--out', {str(tmp_path)!r}], standalone_mode=False)"
    said = python(f"import sys\nfrom cosim.cli import app\n{run}\nprint(*sys.modules)")
    assert {"h5py", "matplotlib", "mujoco"} <= set(said.split())
    assert not set(said.split()) & {"xarray", "pandas", "pyvista"}


def test_a_run_saved_and_opened_is_the_same(tmp_path):
    result = cosim.run(cosim.load("split_edc").replace(PLAIN))
    again = cosim.open_run(result.save(tmp_path))
    assert type(again) is cosim.Result
    assert again.tip_force == result.tip_force
    assert again.summary == result.summary
    assert again.case_table == result.case_table
    assert again.audit.passed
    assert again.audit.bounds == result.audit.bounds
    assert len(repr(again)) < 200
    copied = cosim.open_run(again.save(tmp_path / "copy"))
    assert copied.tip_force == result.tip_force
    rows = again.ledger
    assert set(rows.state) == {"loaded", "unloaded"}
    assert rows[rows.body == "distal"].groupby("state").force_dorsal.sum().abs().max() < 1e-6


def things_shown(result: cosim.Result) -> int:
    plotter = result.view()
    count = len(plotter.actors)
    plotter.close()
    return count


@pytest.mark.parametrize(
    "name", [pytest.param("network_edc", marks=pytest.mark.slow), "cable_edc", "motion"]
)
def test_a_run_opened_shows_what_the_fresh_one_does(tmp_path, monkeypatch, name):
    pyvista = pytest.importorskip("pyvista")
    monkeypatch.setattr(pyvista, "OFF_SCREEN", True)
    case = cosim.load("split_edc" if name == "motion" else name).replace(PLAIN)
    if name == "motion":
        moves = {"duration": "2 ms", "must_rest": False}
        case = case.replace({"finger.tip.kind": "free", "forward": moves})
    fresh = cosim.run(case)
    again = cosim.open_run(fresh.save(tmp_path))
    assert things_shown(fresh) == things_shown(again) >= 8
    for kind in ("scene", "ledger"):
        drawn = [tmp_path / f"{kind}{i}.png" for i in range(2)]
        for result, path in zip((fresh, again), drawn, strict=True):
            result.plot(kind, path)
        one, other = (plt.imread(path) for path in drawn)
        assert (np.abs(one - other) > 0.02).mean() < 1e-4  # a ledger's file has nine digits
    table = cosim.compare(fresh, again)
    assert table[fresh.name].equals(table[f"{fresh.name} (2)"])
    pages = [
        cosim.write_report(r, out=tmp_path / f"{i}.html") for i, r in enumerate((fresh, again))
    ]
    one_page, other_page = (page.read_text(encoding="utf-8") for page in pages)
    assert one_page == other_page


def test_replacing_tells_every_fault_at_once():
    case = cosim.load("isometric_edc")
    with pytest.raises(cosim.InputError) as caught:
        case.replace({"tendons.EDC.tension": 3, "hood.mesh.quods": 4})
    assert "2 faults" in str(caught.value)
    assert "bare number" in str(caught.value)
    assert "quads" in str(caught.value)
    tension, quads = caught.value.faults[1], caught.value.faults[0]
    assert (quads.place, quads.found) == ("hood.mesh.quods", "4")
    assert (tension.place, tension.found, tension.source) == ("tendons.EDC.tension", "3", "replace")
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.faults) == (str(caught.value), caught.value.faults)
    assert case.replace({"hood.mesh.quads": 300}).hood.mesh.quads == 300
    assert case.replace({}, name="other").name == "other"


def test_quantities_of_pint_are_taken():
    pint = pytest.importorskip("pint")
    units = pint.UnitRegistry()
    case = cosim.load("isometric_edc").replace({"hood.thickness": 0.5 * units.mm})
    assert case.hood.thickness == pytest.approx(5e-4)
    stiff = case.replace({"hood.contact.stiffness": 200 * units.N / units.mm**3})
    assert stiff.hood.contact.stiffness == pytest.approx(2e11)


def test_values_of_numpy_and_parts_of_pint_are_what_they_are():
    pint = pytest.importorskip("pint")
    units = pint.UnitRegistry()
    values = {
        "hood.mesh.quads": np.arange(250, 600, 100)[0],
        "output.picture": np.bool_(False),
        "tendons.EDC.activation": 20 * units.percent,
        "title": np.str_("mine"),
    }
    case = cosim.load("isometric_edc").replace(values, name=np.str_("other"))
    assert (case.hood.mesh.quads, case.output.picture, case.name) == (250, False, "other")
    assert (case.tendons["EDC"].activation, type(case.name)) == (0.2, str)
    half = case.replace({"tendons.EDC.activation": units.Quantity(np.float32(0.5), "")})
    assert half.tendons["EDC"].activation == 0.5
    turned = case.replace({"finger.posture.PIP": 30 * units.deg})  # no part, though pint says so
    assert pytest.approx(np.radians(30)) == turned.finger.posture.PIP


def test_a_case_is_taken_by_name_path_table_and_result(tmp_path):
    case = cosim.load("split_edc").replace(PLAIN)
    fresh = cosim.run(case)
    again = cosim.open_run(fresh.save(tmp_path))
    path = tmp_path / "split_edc" / "case.toml"
    for given in ("split_edc", path, str(path), {"extends": "split_edc"}, case, fresh, again):
        assert cosim.run(given).tip_force == fresh.tip_force
        assert cosim.load(given, ["tendons.EDC.tension=2 N"]).tension("EDC") == 2.0
        assert len(cosim.moment_arms(given, 1)) > 0
    assert [cosim.load(r).name for r in (case, fresh, again)] == 3 * ["split_edc"]
    assert [r.tip_force for r in cosim.run_many(iter(["split_edc", again]))] == 2 * [
        fresh.tip_force
    ]
    assert cosim.compare(tmp_path / "split_edc", fresh).shape[1] == 3
    push = {"distal": -1, "dorsal": -2, "radial": None}
    assert (
        cosim.estimate(again, push).tension_N.tolist()
        == cosim.estimate(case, push).tension_N.tolist()
    )


LONE = "\ud800"
"""Half of a letter, which no file can hold."""


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: cosim.run(3), "case: expected the name of a packaged case.* not 3"),
        (lambda: cosim.run("split_edc", "session"), "session: expected a Session"),
        (lambda: cosim.run_many("split_edc"), "cases: expected a list of cases"),
        (lambda: cosim.run_many(["split_edc", None]), r"cases\[1\]: expected the name"),
        (
            lambda: cosim.run_many(["split_edc"], workers=0),
            "workers: expected a whole number from 1",
        ),
        (lambda: cosim.run_many(["split_edc"], workers="2"), "workers: expected a whole number"),
        (lambda: cosim.run_many(["split_edc"], workers=True), "workers: expected a whole number"),
        (lambda: cosim.load("split_edc", "a=b"), "settings: expected a list of texts"),
        (lambda: cosim.compare(), "compare: expected one or more"),
        (lambda: cosim.compare(cosim.load("split_edc")), r"results\[0\].*cosim.run\(case\)"),
        (lambda: cosim.compare(None), r"results\[0\]: expected a Result"),
        (lambda: cosim.moment_arms("split_edc", -1), "steps: expected a whole number from 1"),
        (lambda: cosim.moment_arms("split_edc", 10**7), "steps: expected a whole number"),
        (
            lambda: cosim.estimate("split_edc", {"distal": np.nan}),
            "force.distal: expected a finite",
        ),
        (
            lambda: cosim.estimate("split_edc", {"distal": "nan N"}),
            "force.distal = 'nan N': is not",
        ),
        (lambda: cosim.estimate("split_edc", {"distal": True}), "force.distal: expected a finite"),
        (lambda: cosim.estimate("split_edc", dict.fromkeys(AXES)), "force: every component is"),
        (lambda: cosim.estimate("split_edc", [1, 2, 3]), "force: expected values by name"),
        (lambda: cosim.estimate("split_edc", torques=[1]), "torques: expected values by name"),
        (lambda: cosim.estimate("split_edc", torques={"PIP": np.inf}), "torques.PIP: expected"),
        (
            lambda: cosim.couple("split_edc", "split_edc", {"EDC": -3}),
            "tensions.EDC = -3: must be 0",
        ),
        (lambda: cosim.couple("split_edc", "split_edc", {"EDC": "3 kg"}), "no unit of force"),
        (lambda: cosim.couple("split_edc", "split_edc", "3 N"), "tensions: expected values by"),
        (lambda: cosim.couple("split_edc", "split_edc", {"EDC": 3}, resting=-1), "resting = -1"),
        (lambda: cosim.couple("split_edc", "split_edc", {"EDC": 3}, {"PIP": "x"}), "posture.PIP"),
        (lambda: cosim.couple("split_edc", 3, {"EDC": 3}), "hood: expected the name of"),
        (lambda: cosim.identify(3, "data.csv"), r"cases\[0\]: expected"),
        (lambda: cosim.identify("split_edc", 3), "targets: expected a path"),
        (lambda: cosim.open_run(3), "folder: expected a path"),
        (lambda: cosim.open_run("a\0b"), "folder: expected a path"),
        (lambda: cosim.run_study(3), "study: expected a path"),
        (lambda: cosim.validate(3), "only: expected"),
        (lambda: cosim.write_report(), "a report needs one run"),
        (lambda: cosim.write_report(3), r"runs\[0\]: expected a Result"),
        (lambda: cosim.load("split_edc").replace({}, name="a/b"), "name = 'a/b': expected a name"),
        (lambda: cosim.load("split_edc").replace({}, name="x\0"), "expected a name that a folder"),
        (lambda: cosim.load("split_edc").replace({}, name=".."), "expected a name that a folder"),
        (lambda: cosim.load("split_edc").replace({}, name=LONE), "expected a name that a folder"),
        (lambda: cosim.load("split_edc").replace({}, name=3), "expected a name that a folder"),
        (lambda: cosim.load("split_edc").replace([1]), "replace: expected values by dotted key"),
        (lambda: cosim.load("split_edc").replace({1: 2}), "replace: expected values by dotted key"),
        (lambda: cosim.load("split_edc" + LONE), "expected the name of a packaged case"),
    ],
)
def test_what_an_argument_cannot_be_is_said_with_what_was_expected(call, words):
    with pytest.raises(cosim.InputError, match=words) as caught:
        call()
    str(caught.value).encode("utf-8")  # it can be printed
    assert " --" not in str(caught.value)  # no option of a command


def test_a_figure_is_written_in_a_known_format_only(tmp_path):
    result = cosim.run("split_edc")
    with pytest.raises(cosim.InputError, match=r"not written as 'xyz'; .*png"):
        result.plot(path=tmp_path / "a.xyz")
    assert not list(tmp_path.iterdir())


def test_a_table_is_a_case():
    case = cosim.load({"extends": "pulley_edc", "title": "mine"})
    assert (case.name, case.title, case.hood.kind) == ("case", "mine", "pulley")
    with pytest.raises(cosim.InputError, match="the table"):
        cosim.load({"extends": "pulley_edc", "titel": "mine"})


def test_results_are_compared_with_each_other_and_with_data(tmp_path):
    case = cosim.load("split_edc").replace(PLAIN)
    one, other = (cosim.run(case.replace({}, name=name)) for name in ("one", "other"))
    table = cosim.compare(one, other)
    assert (table.one == table.other).mean() > 0.9  # but for the wall time
    assert table.unit["fingertip_force_N.distal"] == "N"
    assert list(cosim.compare(one, one, one).columns) == ["unit", "one", "one (2)", "one (3)"]
    file = tmp_path / "measured.csv"
    file.write_text(
        "name,quantity,unit,reference,sd,low,high,source,kind,case,geometry,fitted,note\n"
        "Force,fingertip_magnitude_N,N,0.5,0.1,,,me,experiment,,,,\n"
    )
    rows = cosim.compare(one, data=file)
    assert set(rows.verdict) <= {"inside 1 SD", "outside"}


def test_a_hood_of_ones_own_is_coupled_without_a_case_file():
    case = cosim.load("pulley_edc")
    hood = build(case).hood
    found = cosim.couple(case, hood, {"EDC": 3.469}, resting=0.05)
    run = cosim.run(case.replace(PLAIN))
    assert found.known_balance.tip_force == pytest.approx(
        np.array(list(run.tip_force.values())), abs=1e-5
    )
    with pytest.raises(cosim.InputError, match="no tendon ECD"):
        cosim.couple(case, hood, {"ECD": 1.0})


def test_what_is_coupled_has_the_names_of_a_result():
    """Here of a run's finger and hood, under its tensions."""
    run = cosim.run(cosim.load("split_edc").replace(PLAIN))
    found = cosim.couple("split_edc", "split_edc", run.summary["tension_N"])
    assert found.tip_force == pytest.approx(run.tip_force, abs=1e-5)
    assert found.slips == pytest.approx(run.slips, rel=1e-5)
    assert found.excursions == pytest.approx(run.excursions, abs=1e-5)
    assert found.audit.passed
    assert found.audit.bounds.items() <= run.audit.bounds.items()
    for name in ("joint_torques", "joint_forces"):
        one, other = getattr(found, name), getattr(run, name)
        np.testing.assert_allclose(one, other.loc[one.index, one.columns], atol=1e-3)
    arms = found.moment_arms
    np.testing.assert_allclose(arms, run.moment_arms.loc[arms.index, arms.columns], atol=1e-6)
    assert "fingertip force" in repr(found)
    by_text = cosim.couple("split_edc", "split_edc", {"EDC": "3000 mN"}, {"PIP": "45 deg"})
    by_number = cosim.couple("split_edc", "split_edc", {"EDC": 3}, {"PIP": np.radians(45)})
    assert by_text.tip_force == by_number.tip_force


def test_the_hood_of_one_case_is_laid_on_the_finger_of_another():
    """Whose posture and tip it then has: as one case that says both."""
    bent = ["finger.posture.PIP=60 deg"]
    finger = cosim.load("pulley_edc", bent)
    found = cosim.couple(finger, "split_edc", {"EDC": 3.0})
    both = cosim.load("split_edc", [*bent, "solve.resting_tension=0 N"])
    run = cosim.run(both.replace({**PLAIN, "tendons": {"EDC": {"tension": "3 N"}}}))
    assert found.tip_force == pytest.approx(run.tip_force, abs=1e-4)


def test_many_runs_are_the_same_for_any_number_of_workers(tmp_path):
    names = ("split_edc", "pulley_edc", "two_band_edc")
    cases = [cosim.load(name).replace(PLAIN) for name in names]
    heard: list[str] = []
    one, two = cosim.run_many(cases), cosim.run_many(cases, workers=2, progress=heard.append)
    assert [result.case for result in two] == list(names)
    assert heard[-1].startswith("3 of 3: ")
    for a, b in zip(one, two, strict=True):
        files = [r.save(tmp_path / side) for side, r in (("one", a), ("two", b))]
        for name in ("results.nc", "ledger.csv", "case.toml"):
            assert (files[0] / name).read_bytes() == (files[1] / name).read_bytes(), name


def test_of_many_runs_one_that_fails_is_raised_or_kept():
    case = cosim.load("pulley_edc").replace(PLAIN)
    bad = case.replace({"solve.max_iterations": 1}, name="bad")
    with pytest.raises(cosim.ConvergenceError):
        cosim.run_many([bad, case])
    failed, good = cosim.run_many([bad, case], keep_errors=True)
    assert isinstance(failed, cosim.ConvergenceError)
    assert isinstance(good, cosim.Result)


def test_a_result_draws_itself(tmp_path):
    result = cosim.run(cosim.load("network_edc").replace(PLAIN))
    for kind, ending in (("scene", "svg"), ("scene", "png"), ("ledger", "pdf")):
        path = tmp_path / f"{kind}.{ending}"
        result.plot(kind, path)
        assert 1_000 < path.stat().st_size < 2_000_000
    with pytest.raises(cosim.InputError, match="no 'history'; it has scene, ledger"):
        result.plot("history")
    page = result._repr_html_()
    assert "checks of the audit were kept" in page
    assert page.count("<table>") == 3
    assert "data:image/png;base64," in page


def test_the_labelled_vectors_are_those_of_the_summary():
    result = cosim.run(cosim.load("network_edc").replace(PLAIN))
    assert result.excursions == pytest.approx(result.summary["excursion_mm"])
    assert result.moment_arms.loc["EDC", "PIP"] == result.summary["moment_arm_mm"]["EDC"]["PIP"]
    assert result.joint_torques.sum().abs().max() < 1e-6
    assert result.strain.empty


@pytest.mark.parametrize("name", ["split_edc", "planar_edc", "pulley_edc"])
def test_a_joint_bears_what_acts_beyond_it(name):
    """Force balance of the bones distal of each joint, from the ledger."""
    result = cosim.run(cosim.load(name).replace(PLAIN))
    rows = result.ledger
    beyond = rows[(rows.state == "loaded") & (rows.source != "joint")]
    bodies = list(dict.fromkeys(rows.body))[1:]
    forces = result.joint_forces
    assert list(forces.index) == ["MCP", "PIP", "DIP"]
    for i, joint in enumerate(forces.index):
        sum_of = beyond[beyond.body.isin(bodies[i:])]
        for axis in ("distal", "radial", "dorsal"):
            balance = forces.loc[joint, axis] + sum_of[f"force_{axis}"].sum()
            assert abs(balance) < 1e-9, (joint, axis)


@pytest.fixture(scope="module")
def shell() -> cosim.Result:
    return cosim.run(cosim.load("fingertip_isotropic_edc").replace({**PLAIN, **COARSE}))


def test_the_arrays_say_what_they_are(shell):
    data = shell.data
    assert data.attrs["Conventions"].startswith("CF-")
    assert data.attrs["title"] == shell.title
    assert "z dorsal" in data.attrs["frame"]
    assert all("," not in variable.attrs["units"] for variable in data.data_vars.values())
    assert data.sizes["quad"] == len(data.region) == len(data.quad_node)
    assert int(data.quad_node.max()) < data.sizes["point"]
    assert "central_slip" in set(data.region.values)


def test_a_result_is_shown_in_space(monkeypatch, shell):
    pyvista = pytest.importorskip("pyvista")
    monkeypatch.setattr(pyvista, "OFF_SCREEN", True)
    plotter = shell.view()
    assert len(plotter.actors) >= 8  # four bones, the hood, tendons, an arrow
    plotter.close()


@pytest.mark.parametrize("name", ["meshes.py", "cases.py", "rigid/__init__.py"])
def test_a_file_that_hides_a_package_of_ours_is_named(tmp_path, name):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("mine = 1\n")
    script = tmp_path / "script.py"
    script.write_text("import cosim\n")
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, script], env=env, capture_output=True, text=True)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("ImportError: cosim needs the package ")
    assert f"{path} first. Rename" in last


def test_a_folder_that_is_no_package_does_no_harm(tmp_path):
    (tmp_path / "meshes").mkdir()
    script = tmp_path / "script.py"
    script.write_text("import cosim\nprint(cosim.load('pulley_edc').name)\n")
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, script], env=env, capture_output=True, text=True)
    assert done.stdout == "pulley_edc\n", done.stderr


@pytest.fixture
def held(tmp_path, monkeypatch):
    """A case file of bones that are held, in the folder in which the test runs."""
    (tmp_path / "held.toml").write_text(HELD, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "held.toml"


def test_parameters_are_fitted_to_values(held):
    (held.parent / "data.csv").write_text(
        "quantity,value,sd\njoint_torque_Nmm.passive.PIP,-30,0.1\n", encoding="utf-8"
    )
    (held.parent / "free.toml").write_text(
        "[k]\nlow = 1\nhigh = 1000\nstart = 50\nunit = 'N*mm/rad'\n"
        "settings = ['finger.passive.PIP.stiffness={value}']\n",
        encoding="utf-8",
    )
    bent = ["finger.posture.PIP=30 deg"]
    found = cosim.identify("held.toml", "data.csv", "free.toml", bent)
    assert found.values["k"] == pytest.approx(30 / np.radians(30), rel=1e-3)
    case = cosim.load("held.toml", bent)
    assert cosim.identify([case], "data.csv", "free.toml").values == found.values


def test_a_study_is_run_and_read(held):
    (held.parent / "pip.toml").write_text(
        'case = "held.toml"\n[parameters.PIP]\nvalues = ["20 deg", "40 deg"]\n'
        'settings = ["finger.posture.PIP={value}"]\n[outputs]\n'
        'torque = "joint_torque_Nmm.passive.PIP"\n',
        encoding="utf-8",
    )
    heard: list[str] = []
    found = cosim.run_study("pip.toml", progress=heard.append)
    assert found.values("torque") == pytest.approx(-40 * np.radians([20, 40]), rel=1e-9)
    assert heard[-1] == "2 of 2"
    assert (held.parent / "studies" / "pip" / "index.html").is_file()


def test_tensions_are_estimated_from_a_force_or_from_torques():
    case = cosim.load("split_edc")
    by_text = cosim.estimate(case, {"distal": "-1 N", "dorsal": "-2000 mN", "radial": None})
    by_number = cosim.estimate(case, {"distal": -1.0, "dorsal": -2.0, "radial": None})
    assert by_text.tension_N.tolist() == by_number.tension_N.tolist()
    assert by_number.attrs["forward"] == pytest.approx(by_number.attrs["asked"], abs=1e-3)
    torques = cosim.estimate(case, torques={"PIP": "50 N*mm"})
    assert torques.attrs["asked"]["PIP"] == pytest.approx(0.05)
    for words in ({}, {"force": {"distal": 1}, "torques": {"PIP": 1}}):
        with pytest.raises(cosim.InputError, match="a force or torques"):
            cosim.estimate(case, **words)
    with pytest.raises(cosim.InputError, match="no axis 'palmar'"):
        cosim.estimate(case, {"palmar": 1.0})


def test_the_model_is_validated_and_reported(tmp_path):
    (board,) = [b for b in cosim.validate("force split EDC", tmp_path) if b.rows]
    assert {row.target.case for row in board.rows} == {"force split EDC"}
    page = cosim.write_report(tmp_path / "force_split_EDC", out=tmp_path / "page.html")
    assert page.stat().st_size > 100_000
