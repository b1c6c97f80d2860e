"""How long the program may be: a ceiling of lines for each room, which a change lowers.

A ceiling is raised only in a commit that says for what.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from tests.helpers.folders import ROOT

CEILINGS = {
    "cases": 3790,
    "cosim": 6497,
    "cosim/analyses": 8500,
    "cosim/anatomy": 872,
    "cosim/case": 1023,
    "cosim/commands": 5379,
    "cosim/coupling": 2258,
    "cosim/fingers": 1437,
    "cosim/fmu": 2036,
    "cosim/fmu_export": 1281,
    "cosim/hoods": 4425,
    "cosim/kernels": 362,
    "cosim/models": 849,
    "cosim/report": 2923,
    "cosim/results": 6335,
    "cosim/schema": 611,
    "cosim/scoring": 1829,
    "cosim/solve": 965,
    "cosim/study": 3441,
    "cosim/tendons": 957,
    "cosim/ui": 1538,
    "cosim/validation": 4430,
    "cosim/verification": 990,
    "fe_solver": 477,
    "fe_solver/elements": 1478,
    "fe_solver/febio": 3632,
    "fe_solver/forces": 1474,
    "fe_solver/hood": 1208,
    "fe_solver/job": 1896,
    "fe_solver/materials": 2842,
    "fe_solver/q4ans": 1425,
    "fe_solver/solver": 2972,
    "fe_solver/surfaces": 1151,
    "fe_solver/verification": 5190,
    "meshes": 3119,
    "meshes/imported": 1173,
    "rigid": 185,
    "rigid/air": 537,
    "rigid/chain": 1468,
    "rigid/fingers": 975,
    "rigid/hoods": 1695,
    "rigid/mjcf": 2383,
    "rigid/mujoco": 2089,
    "rigid/muscle": 1135,
    "rigid/opensim": 3745,
    "rigid/papers": 3272,
    "rigid/verification": 2686,
    "tests": 55647,
}


def test_no_room_is_longer_than_its_ceiling() -> None:
    lines = Counter[str]()
    for package in ("cosim", "fe_solver", "rigid", "meshes", "cases", "tests"):
        for path in (ROOT / package).rglob("*.py"):
            lines[_room(path.relative_to(ROOT))] += len(path.read_text("utf-8").splitlines())
    assert set(lines) == set(CEILINGS)
    above = {room: n for room, n in lines.items() if n > CEILINGS[room]}
    assert not above, f"longer than their ceilings: {above}; take lines out, or say for what"


def _room(file: Path) -> str:
    """`cosim/study` for a file of a room, `cosim` for one that lies beside the rooms."""
    inside = file.parts[0] in ("cosim", "fe_solver", "rigid", "meshes") and len(file.parts) > 2
    return "/".join(file.parts[: 1 + inside])
