"""Who may import whom, and what a light command must not load."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter

import pytest

from cosim.fingers.kinds import FINGERS
from cosim.hoods.kinds import KINDS
from tests.helpers.folders import ROOT

PACKAGES = ("cosim", "fe_solver", "rigid", "meshes", "cases")
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
}
# What a module, or each of a package, may import of ours, at the top or inside a function.
ALLOWED = {
    "cosim.port": (),
    "cosim.static_response": ("cosim.port", "cosim.array_cache"),
    "cosim.coupling.equilibrium": (
        *("cosim.port", "cosim.static_response"),
        "cosim.coupling.finger_equilibrium",
    ),
    "cosim.coupling.finger_equilibrium": ("cosim.port",),
    "cosim.files": (),
    "cosim.number_text": (),
    "cosim.array_cache": ("cosim.files", "cosim.content_key"),
    "cosim.content_key": (),
    "cosim.stopwatch": (),
    "cosim.processes": ("cosim.interrupts",),
    "cosim.interrupts": (),
    "cosim.extras": (),
    "cosim.abaqus_file": ("cosim.files", "cosim.number_text"),
    "cosim.mesh_file": (
        *("cosim.abaqus_file", "cosim.extras", "cosim.files", "cosim.processes"),
        "cosim.port",
    ),
    "cosim.xml_tree": ("cosim.port", "cosim.number_text"),
    "cosim.vtu_child": (),
    "cosim.kernels": ("cosim.kernels",),
    "cosim.coupling.accelerators": ("cosim.port",),
    "cosim.coupling.state": ("cosim.port", "cosim.coupling.accelerators"),
    "cosim.coupling.schemes": (
        *("cosim.port", "cosim.static_response", "cosim.stopwatch"),
        *("cosim.coupling.accelerators", "cosim.coupling.state"),
    ),
    "cosim.coupling.adaptive": ("cosim.port", "cosim.coupling.state", "cosim.coupling.schemes"),
    "cosim.coupling.excursion": ("cosim.port",),
    "cosim.coupling.motion": (
        "cosim.port",
        "cosim.coupling.state",
        "cosim.coupling.excursion",
        "cosim.coupling.events",
        "cosim.coupling.schemes",
    ),
    "cosim.coupling.state_arrays": ("cosim.port",),
    "cosim.coupling.one_way": ("cosim.port",),
    "cosim.coupling.fixed_point": (
        "cosim.port",
        "cosim.static_response",
        "cosim.coupling.accelerators",
        "cosim.coupling.equilibrium",
        "cosim.coupling.finger_equilibrium",
    ),
    "fe_solver": (
        *("cosim.port", "cosim.files", "cosim.mesh_file", "cosim.processes"),
        *("cosim.xml_tree", "cosim.kernels", "cosim.array_cache", "cosim.content_key"),
        *("cosim.extras", "cosim.number_text", "cosim.stopwatch", "fe_solver"),
    ),
    "rigid": (
        *("cosim.port", "cosim.coupling.finger_equilibrium", "cosim.files"),
        *("cosim.xml_tree", "cosim.kernels", "cosim.number_text"),
        *("meshes.skeleton", "rigid"),
    ),
    "meshes": (
        *("cosim.port", "cosim.extras", "cosim.files", "cosim.mesh_file"),
        "meshes",
    ),
}
# The rooms of cosim from the ground up: each may import its own modules and those of floors below.
FLOORS = (
    {
        "cosim.errors",
        "cosim.version",
        "cosim.vtu_child",
        "cosim.kernels",
        "cosim.json_text",
        "cosim.interrupts",
        "cosim.number_text",
        "cosim.stopwatch",
    },
    {"cosim.port", "cosim.extras", "cosim.files", "cosim.processes"},
    {"cosim.abaqus_file"},
    {"cosim.schema", "cosim.mesh_file", "cosim.outcome"},
    {"cosim.roughness"},
    {"cosim.content_key"},
    {"cosim.array_cache"},
    {"cosim.xml_tree", "cosim.text_tables", "cosim.static_response"},
    {"cosim.tendons", "cosim.measured"},
    {"cosim.coupling"},
    {"cosim.fmu"},
    {"cosim.fingers"},
    {"cosim.hoods"},
    {"cosim.case"},
    {"cosim.models"},
    {"cosim.solve"},
    {"cosim.results"},
    {"cosim.pipeline"},
    {"cosim.fmu_export", "cosim.report"},
    {"cosim.anatomy", "cosim.analyses", "cosim.study"},
    {"cosim.validation", "cosim.ui"},
    {"cosim.scoring"},
    {"cosim.arguments"},
    {"cosim.face"},
    {"cosim.loop"},
    {"cosim.gym"},
    {"cosim.commands"},
    {"cosim.cli"},
    {"cosim.__main__"},
)
# The papers' scripts and models, which proofs use, and no case.
PAPERS = ("cases.papers",)
# A kind of finger or hood is built on a solver.
ROOMS_OF_SOLVERS = ("cosim.fingers", "cosim.hoods")
# They ask live hoods behind the port, which have no tables: for their states, and for FEBio.
LIVE = {"cosim.models.motion", "cosim.commands.febio"}
KNOW_THE_SOLVERS = {
    "cosim.analyses.estimate.joint_motion",
    "cosim.analyses.estimate.markers",
    "cosim.analyses.estimate.of_case",
    "cosim.analyses.estimate.tensions",
    "cosim.analyses.estimate.tracking",
    "cosim.analyses.mjcf_hood",
    "cosim.analyses.opensim.loads",
    "cosim.analyses.opensim.tensions",
    "cosim.analyses.trials.by_tangent",
    "cosim.anatomy.carry",
    "cosim.anatomy.case_folder",
    "cosim.anatomy.feb",
    "cosim.anatomy.own_case",
    "cosim.anatomy.read",
    "cosim.models.build",
    "cosim.models.febio",
    "cosim.models.motion",
    "cosim.commands.febio",
    "cosim.commands.imports",
    "cosim.commands.info",
    "cosim.commands.mjcf",
    "cosim.commands.warm",
    "cosim.results.sto",
    "cosim.scoring.model",
    "cosim.scoring.names",
    "cosim.solve.one_way",
    "cosim.tendons.air",
    "cosim.tendons.friction",
    "cosim.tendons.signals",
    "cosim.tendons.muscles",
    "cosim.validation.run",
}


@cache
def imports(module: str, top_only: bool) -> tuple[str, ...]:
    """Our modules that a module imports; with `top_only` those that importing it loads."""
    return tuple(_imports(module, top_only))


def _imports(module: str, top_only: bool) -> Iterator[str]:
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
    assert {"cosim.port", "fe_solver.hood.shell_hood", "rigid.hoods.pulley", "meshes.hood"} <= set(
        MODULES
    )
    assert "meshes.skeleton" in set(imports("rigid.fingers.index", top_only=True))
    assert "fe_solver.solver.newton" in set(imports("fe_solver.hood.shell_hood", top_only=True))
    assert "rigid.chain.hinge" in set(imports("cosim.fingers.hinge", top_only=False))
    assert "rigid.chain.hinge" not in set(imports("cosim.fingers.hinge", top_only=True))


@pytest.mark.parametrize("room", ALLOWED)
def test_a_room_imports_only_what_lies_below_it(room):
    for module in (m for m in MODULES if _is_within(m, room)):
        for name in imports(module, top_only=False):
            allowed = (*ALLOWED[room], "cosim.errors")
            assert any(_is_within(name, rule) for rule in allowed), f"{module} imports {name}"


def _floor(module: str) -> tuple[int, str]:
    """The number of a module's floor, and its room."""
    found = [
        (i, room) for i, rooms in enumerate(FLOORS) for room in rooms if _is_within(module, room)
    ]
    assert len(found) == 1, f"{module} is in {len(found)} rooms"
    return found[0]


def test_imports_lead_downwards():
    against = set()
    for module in (m for m in MODULES if _is_within(m, "cosim") and m != "cosim"):
        floor, room = _floor(module)
        for name in imports(module, top_only=False):
            if _is_within(name, "cosim") and name != "cosim":
                other_floor, other_room = _floor(name)
                if other_room != room and other_floor >= floor:
                    against.add((module, name))
    assert not against


def test_nothing_uses_the_papers():
    using = {
        module
        for module in MODULES
        for name in imports(module, top_only=False)
        if any(_is_within(name, papers) for papers in PAPERS)
        if not any(_is_within(module, room) for room in PAPERS)
    }
    assert not using


def test_nothing_installed_uses_the_tests():
    """Proofs, benches and helpers."""
    using = {
        module
        for module, path in MODULES.items()
        if re.search(r"^\s*(?:from|import) tests\b", path.read_text(encoding="utf-8"), re.M)
    }
    assert not using


def test_only_kinds_and_build_know_the_solvers():
    knowing = {
        module
        for module in MODULES
        for name in imports(module, top_only=False)
        if _is_within(module, "cosim") and name.split(".")[0] in ("fe_solver", "rigid")
        if not any(_is_within(module, room) for room in ROOMS_OF_SOLVERS)
    }
    assert knowing == KNOW_THE_SOLVERS


def test_no_modules_import_each_other_in_a_circle():
    """Imports inside functions and those for type checkers count."""
    graph = {module: set(imports(module, top_only=False)) - {module} for module in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        raise AssertionError(f"circle: {' <- '.join(error.args[1])}") from None


def test_types_are_asked_for_seldom_and_kinds_never():
    """What differs between kinds of fingers and hoods is said by the kind."""
    lines = {
        module: [
            line for line in path.read_text(encoding="utf-8").splitlines() if "isinstance" in line
        ]
        for module, path in MODULES.items()
    }
    for reader in ("cosim.arguments", "fe_solver.given"):
        del lines[reader]  # which reads whatever a user hands to the face, or to a job
    assert sum(map(len, lines.values())) <= 170
    tables = "|".join(kind.table.__name__ for kind in (*KINDS.values(), *FINGERS.values()))
    ladder = re.compile(rf"isinstance\([^)]*(?:case|hood|finger)\b[^)]*\b(?:{tables})\b")
    own = {m for m in lines if _is_within(m, "cosim.hoods") or _is_within(m, "cosim.fingers")}
    asking = {m for m in set(lines) - own for line in lines[m] if ladder.search(line)}
    assert asking <= LIVE


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("fe_solver.hood.shell_hood", {"mujoco", "pydantic", "typer"}),
        ("cosim.cli", {"mujoco", "scipy", "pyvista", "matplotlib", "xarray", "fe_solver", "rigid"}),
        ("cosim.cli", {"dask", "distributed", "pyarrow", "pandas", "SALib"}),
        ("cosim.commands.run", {"mujoco", "scipy", "matplotlib", "xarray", "numba", "pint"}),
        ("cosim.commands.run", {"cosim.study", "cosim.analyses", "cosim.ui", "cosim.report"}),
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
