"""Who may import whom, and what a light command must not load."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("cosim", "fe_solver", "rigid", "meshes", "cases")
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
}
# What a module, or each of a package, may import of ours, at the top or inside a function.
ALLOWED = {
    "cosim.port": (),
    "cosim.coupling.equilibrium": ("cosim.port", "cosim.coupling.finger_equilibrium"),
    "cosim.coupling.finger_equilibrium": ("cosim.port",),
    "cosim.files": ("cosim.port",),
    "cosim.processes": (),
    "cosim.mesh_file": ("cosim.port",),
    "cosim.vtu_child": (),
    "cosim.checks": ("cosim.port",),
    "cosim.coupling.accelerators": ("cosim.port",),
    "cosim.coupling.state": ("cosim.port", "cosim.coupling.accelerators"),
    "cosim.coupling.schemes": ("cosim.port", "cosim.coupling.accelerators", "cosim.coupling.state"),
    "cosim.coupling.adaptive": ("cosim.port", "cosim.coupling.state", "cosim.coupling.schemes"),
    "cosim.coupling.excursion": ("cosim.port",),
    "cosim.coupling.motion": (
        "cosim.port",
        "cosim.coupling.state",
        "cosim.coupling.excursion",
        "cosim.coupling.schemes",
    ),
    "cosim.coupling.state_arrays": ("cosim.port",),
    "cosim.coupling.one_way": ("cosim.port",),
    "cosim.coupling.fixed_point": (
        "cosim.port",
        "cosim.coupling.accelerators",
        "cosim.coupling.equilibrium",
        "cosim.coupling.finger_equilibrium",
    ),
    "fe_solver": (
        *("cosim.port", "cosim.mesh_file", "cosim.processes", "cosim.checks"),
        "fe_solver",
    ),
    "rigid": (
        *("cosim.port", "cosim.coupling.finger_equilibrium", "cosim.files", "cosim.checks"),
        *("meshes.skeleton", "rigid"),
    ),
    "meshes": ("cosim.port", "cosim.mesh_file", "meshes"),
}
KNOW_THE_SOLVERS = {
    "cosim.anatomy.read",
    "cosim.anatomy.case_folder",
    "cosim.anatomy.feb",
    "cosim.build.models",
    "cosim.tendons.air",
    "cosim.hoods.cable.build",
    "cosim.tendons.courses",
    "cosim.hoods.fe_view",
    "cosim.hoods.shell.fibres",
    "cosim.fingers.kinds",
    "cosim.build.fit",
    "cosim.build.motion",
    "cosim.hoods.lumped.build",
    "cosim.tendons.muscles",
    "cosim.solve.one_way",
    "cosim.hoods.cable.robot",
    "cosim.analyses.estimate.joint_motion",
    "cosim.analyses.estimate.tensions",
    "cosim.analyses.estimate.of_case",
    "cosim.finger_commands",
    "cosim.analyses.hood.literature",
    "cosim.hoods.shell.region_forces",
    "cosim.hoods.shell.build",
    "cosim.hoods.shell.view",
    "cosim.shell_commands",
    "cosim.job_commands",
    "cosim.analyses.trials.by_tangent",
    "cosim.opensim_commands",
    "cosim.analyses.opensim.loads",
    "cosim.analyses.opensim.tensions",
    "cosim.results.sto",
    "cosim.validation_published",
    "cosim.verification_pairs",
}


def imports(module: str, top_only: bool) -> Iterator[str]:
    """Our modules that a module imports; with `top_only` those that importing it loads."""
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    for node in _top(tree) if top_only else ast.walk(tree):
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found = list(_from(module, node))
        else:
            continue
        yield from (name for name in found if name.split(".")[0] in PACKAGES)


def _top(tree: ast.Module) -> Iterator[ast.stmt]:
    """The statements that run on import, those for type checkers left out."""
    for node in tree.body:
        is_for_types = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        if not is_for_types:
            yield node


def _from(module: str, node: ast.ImportFrom) -> Iterator[str]:
    package = module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]
    base = ".".join(package.split(".")[: package.count(".") + 2 - node.level]) if node.level else ""
    name = ".".join(part for part in (base, node.module) if part)
    for alias in node.names:
        inner = f"{name}.{alias.name}"
        yield inner if inner in MODULES else name


def _is_within(name: str, room: str) -> bool:
    return name == room or name.startswith(f"{room}.")


def test_the_modules_are_found():
    assert {"cosim.port", "fe_solver.shell_hood", "rigid.pulley", "meshes.hood"} <= set(MODULES)
    assert "meshes.skeleton" in set(imports("rigid.index_finger", top_only=True))
    assert "fe_solver.newton" in set(imports("fe_solver.shell_hood", top_only=True))
    assert "rigid.hinge" in set(imports("cosim.fingers.kinds", top_only=False))
    assert "rigid.hinge" not in set(imports("cosim.fingers.kinds", top_only=True))


@pytest.mark.parametrize("room", ALLOWED)
def test_a_room_imports_only_what_lies_below_it(room):
    for module in (m for m in MODULES if _is_within(m, room)):
        for name in imports(module, top_only=False):
            assert any(_is_within(name, rule) for rule in ALLOWED[room]), f"{module} imports {name}"


def test_only_build_knows_the_solvers():
    """And the studies of the papers, which are about the solvers' own models."""
    knowing = {
        module
        for module in MODULES
        for name in imports(module, top_only=False)
        if _is_within(module, "cosim") and name.split(".")[0] in ("fe_solver", "rigid")
        if not _is_within(module, "cosim.papers")
    }
    assert knowing == KNOW_THE_SOLVERS


def test_no_modules_import_each_other_in_a_circle():
    graph = {module: set(imports(module, top_only=True)) - {module} for module in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        raise AssertionError(f"circle: {' <- '.join(error.args[1])}") from None


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("fe_solver.shell_hood", {"mujoco", "pydantic", "typer"}),
        ("cosim.cli", {"mujoco", "scipy", "pyvista", "matplotlib", "xarray", "fe_solver", "rigid"}),
        ("cosim.cli", {"dask", "distributed", "pyarrow", "pandas", "SALib"}),
        ("cosim.study", {"dask", "pandas", "xarray", "scipy", "fe_solver", "rigid"}),
        ("cosim.case.file", {"mujoco", "scipy", "xarray", "fe_solver", "rigid"}),
    ],
)
def test_importing_one_does_not_load_the_other(module, heavy):
    code = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert module in loaded
    assert not heavy & loaded
