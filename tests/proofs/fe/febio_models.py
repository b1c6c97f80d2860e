"""Our answers and costs beside FEBio's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from enum import Enum
from pathlib import Path

import numpy as np

from cosim.errors import CosimError, InputError
from fe_solver.febio.read import read_feb
from fe_solver.job.job import Job
from fe_solver.job.model import JobOptions
from fe_solver.job.results import displacement
from fe_solver.job.solve import JobResult, JobState, solve_job
from fe_solver.q4ans.solve import solve_solid
from tests.proofs.fe.febio_figures import PUBLISHED, REFERENCE_S, Published
from tests.proofs.fe.json_command import peak_mb

TOLERANCE = 0.03
REFERENCE_JOB = "reference_job.py"
INPUT_FAULT = 2
"""Exit code of a process whose model is at fault."""


class Formulation(Enum):
    """What a model is solved with: our own shell, or FEBio's element and contact."""

    OWN = "--own-shell"
    Q4ANS = "--element q4ans"


@dataclass(frozen=True)
class ComparedQuantity:
    """One quantity by each element; None where there is no figure."""

    quantity: str
    own: float | None = None
    """By our shell."""
    q4ans: float | None = None
    febio: float | None = None
    """FEBio's own figure."""
    scale: float = 1.0
    """What differences are divided by: of a displacement the largest of the model's nodes, else the
    reference, which is FEBio's figure or else what `q4ans` says."""

    @property
    def reference(self) -> float | None:
        """FEBio's figure, or else what `q4ans` says; None where there is neither."""
        return self.q4ans if self.febio is None else self.febio

    def off(self, value: float | None) -> float | None:
        """A value's relative difference from the reference; None where one of them is missing."""
        if value is None or self.reference is None:
            return None
        return (value - self.reference) / self.scale

    @property
    def verdict(self) -> str:
        """The verdict on our own shell, and where that differs on `q4ans`."""
        if self.reference is None:
            return "no figure"
        for value, word in ((self.own, "agrees"), (self.q4ans, "formulation")):
            off = self.off(value)
            if off is not None and abs(off) <= TOLERANCE:
                return word
        return "differs"


@dataclass(frozen=True)
class ModelRun:
    """One model solved in a process of its own."""

    values: dict[str, float]
    """By name."""
    penetration: float
    """um, the deepest."""
    solve_s: float
    """CPU seconds of the solve."""
    setup_s: float
    """CPU seconds of the set-up (file, model, distances of bones)."""
    import_mb: float
    """Peak memory of the imports alone."""
    peak_mb: float
    """Peak memory of all."""
    iterations: int
    linear_solver: str


@dataclass(frozen=True)
class ModelComparison:
    """A model's rows, and what they took."""

    model: str
    rows: tuple[ComparedQuantity, ...]
    solved: dict[Formulation, ModelRun | str]
    """By element, or why there is no solution."""
    published: Published | None = None
    febio_s: float | None = None
    """FEBio's CPU time scaled to this machine by the reference job, None where that is absent."""


def models_in(folder: Path) -> list[Path]:
    """The FEBio files of a folder.  Raises InputError where there are none."""
    files = sorted(folder.glob("*.feb"))
    if not files:
        raise InputError(f"{folder}: holds no FEBio files (*.feb)")
    return files


def quantities(job: Job, state: JobState, published: Published | None) -> dict[str, float]:
    """What is compared, by name, mm and N: what is published, else the node at rest farthest from
    all that are held, the bodies in contact and the springs."""
    index = {int(n): i for i, n in enumerate(job.sheet.node_ids)}
    if published is None:
        wanted = [(int(job.sheet.node_ids[_loosest(job)]), i) for i in range(3)]
        touched = sorted({pair.body for pair in job.contacts})
    else:
        nodes = published.displacement
        missing = [n for n in nodes if n not in index]
        if missing:
            raise InputError(f"{job.name}: has no node {missing[0]}; it is not the published model")
        wanted = [(n, i) for n in nodes for i in range(3) if nodes[n][i] != 0.0]
        touched = list(range(len(published.contact)))
    u, contact = 1e3 * displacement(job, state), state.contact
    out = {f"u{'xyz'[i]} of node {n} (mm)": float(u[index[n], i]) for n, i in wanted}
    for i in touched:
        out[f"contact z on {job.bodies[i].name} (N)"] = float(contact[i, 2])
    if not state.spring_forces:
        return out
    force = np.concatenate(state.spring_forces)
    out["largest spring (N)"] = float(force.max(initial=0.0))
    out["sum of springs (N)"] = float(force.sum())
    out["active springs"] = float((force > 0).sum())
    return out


def _loosest(job: Job) -> int:
    """The node farthest from those that are tied or held."""
    held = [t.nodes for t in job.ties] + [h.nodes for h in job.held]
    if not held:
        return 0
    x = job.sheet.points[np.concatenate(held)]
    return int(np.linalg.norm(job.sheet.points[:, None] - x, axis=2).min(axis=1).argmax())


def _figures(published: Published) -> list[float]:
    """In the order of `quantities`."""
    moved = [v for u in published.displacement.values() for v in u if v != 0.0]
    return [*moved, *published.contact, published.largest, published.total, float(published.active)]


def rows(
    published: Published | None, solved: Mapping[Formulation, dict[str, float]]
) -> list[ComparedQuantity]:
    """One for each quantity, from the values by name of each element that has a solution."""
    names = next(iter(solved.values()), {})
    figures: list[float | None] = [None] * len(names)
    if published is not None:
        figures = [*_figures(published)]
    shell, q4ans = (solved.get(e, {}) for e in Formulation)
    out = [
        ComparedQuantity(name, shell.get(name), q4ans.get(name), figure)
        for name, figure in zip(names, figures, strict=True)
    ]
    if published is None:
        moved = [r.reference or 0.0 for r in out if r.quantity.startswith("u")]
        largest = float(np.linalg.norm(moved))
    else:
        largest = float(max(np.linalg.norm(u) for u in published.displacement.values()))
    return [replace(r, scale=_scale(r, largest)) for r in out]


def _scale(row: ComparedQuantity, largest: float) -> float:
    size = largest if row.quantity.startswith("u") else abs(row.reference or 0.0)
    return size or 1.0


def compare(folder: Path, spacing: float = 0.25e-3) -> Iterator[ModelComparison]:
    """All models of a folder, solved with each element in a process of its own with one thread.

    Raises InputError where the folder holds none, and where one of them cannot be read."""
    for path in models_in(folder):
        seconds = reference_seconds(folder)  # beside each solve: machines have moods
        solved = {e: measure(path, e, spacing) for e in Formulation}
        published = PUBLISHED.get(path.stem)
        values = {e: m.values for e, m in solved.items() if isinstance(m, ModelRun)}
        scaled = None
        if seconds is not None and published is not None:
            scaled = seconds / REFERENCE_S * published.cpu_s
        yield ModelComparison(path.stem, tuple(rows(published, values)), solved, published, scaled)


def reference_seconds(folder: Path) -> float | None:
    """CPU seconds of the folder's reference job on this machine, one thread; None where the folder
    has none."""
    script = folder / REFERENCE_JOB
    if not script.is_file():
        return None
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, encoding="utf-8", check=False
    )
    try:
        return float(done.stdout)
    except ValueError:
        raise InputError(f"{script}: expected it to print its CPU seconds") from None


def measure(path: Path, element: Formulation, spacing: float) -> ModelRun | str:
    """A model solved in a process of its own; or why there is no solution.

    Raises InputError where the model cannot be read or is not covered by our own shell."""
    one = {"FE_SOLVER_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    one |= {"OPENBLAS_NUM_THREADS": "1"}
    call = [sys.executable, "-m", __name__, str(path), element.name, repr(spacing)]
    done = subprocess.run(
        call,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
        env={**os.environ, **one},
    )
    if not done.returncode:
        return ModelRun(**json.loads(done.stdout))
    reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    if done.returncode == INPUT_FAULT and element != Formulation.Q4ANS:
        raise InputError(reason)
    return reason


def solve_with(path: Path | str, element: Formulation, spacing: float) -> JobResult:
    """A model's end, contact by a penalty alone, as FEBio's figures are."""
    job, options = read_feb(path), JobOptions(None, spacing=spacing)
    if element == Formulation.Q4ANS:
        return solve_solid(job, options=options)
    return solve_job(job, options=options)


def _main(path: str, element: str, spacing: str) -> None:
    """The process of one model: prints a `ModelRun` as JSON."""
    from fe_solver.solver.linear_algebra import backend_name
    from fe_solver.solver.newton import NewtonOptions, solve
    from tests.benches.shell_speed import PULL, rod_sheet
    from tests.proofs.fe.sheets import at_rest

    warm = rod_sheet(64)  # compiles the kernels, or takes them from their cache
    solve(warm, at_rest(warm), PULL, NewtonOptions(tolerance=1e-8))
    imports = peak_mb()
    began = time.process_time()
    result = solve_with(path, Formulation[element], float(spacing))
    spent, last = time.process_time() - began, result.states[-1]
    made = ModelRun(
        quantities(result.job, last, PUBLISHED.get(Path(path).stem)),
        1e6 * last.penetration,
        result.effort.cpu_s,
        spent - result.effort.cpu_s,
        imports,
        peak_mb(),
        result.effort.iterations,
        backend_name(),
    )
    print(json.dumps(asdict(made)))


if __name__ == "__main__":
    try:
        _main(*sys.argv[1:])
    except CosimError as error:
        print(error, file=sys.stderr)
        sys.exit(INPUT_FAULT if isinstance(error, InputError) else 1)
