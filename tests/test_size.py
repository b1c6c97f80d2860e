"""How long the program may be: a ceiling of lines for each room, which a change lowers.

A ceiling is raised only in a commit that says for what.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from tests.helpers.folders import ROOT

CEILINGS = {
    "cases": 3941,
    "cosim": 7016,
    "cosim/analyses": 8573,
    "cosim/anatomy": 956,
    "cosim/case": 1072,
    "cosim/commands": 5404,
    "cosim/coupling": 2241,
    "cosim/fingers": 1447,
    "cosim/fmu": 2043,
    "cosim/fmu_export": 1281,
    "cosim/hoods": 4542,
    "cosim/kernels": 378,
    "cosim/models": 849,
    "cosim/report": 3102,
    "cosim/results": 6444,
    "cosim/schema": 616,
    "cosim/scoring": 1830,
    "cosim/solve": 965,
    "cosim/study": 3441,
    "cosim/tendons": 957,
    "cosim/ui": 1542,
    "cosim/validation": 4575,
    "cosim/verification": 1003,
    "fe_solver": 504,
    "fe_solver/elements": 1513,
    "fe_solver/febio": 3625,
    "fe_solver/forces": 1480,
    "fe_solver/hood": 1266,
    "fe_solver/job": 1899,
    "fe_solver/materials": 2861,
    "fe_solver/q4ans": 1425,
    "fe_solver/solver": 2988,
    "fe_solver/surfaces": 1177,
    "fe_solver/verification": 5190,
    "meshes": 3165,
    "meshes/imported": 1173,
    "rigid": 185,
    "rigid/air": 537,
    "rigid/chain": 1468,
    "rigid/fingers": 1021,
    "rigid/hoods": 1695,
    "rigid/mjcf": 2385,
    "rigid/mujoco": 2089,
    "rigid/muscle": 1135,
    "rigid/opensim": 3783,
    "cases/papers/models": 3272,
    "rigid/verification": 2686,
    "tests": 57353,
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
