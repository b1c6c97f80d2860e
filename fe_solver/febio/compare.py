"""Our answers and costs beside FEBio's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from cosim.port import CosimError, InputError

from ..job import Job
from ..job_model import JobOptions
from ..job_results import displacement, farthest
from ..job_solve import JobState
from .figures import PUBLISHED, REFERENCE_S, Published

TOLERANCE = 0.03
REFERENCE_JOB = "reference_job.py"


@dataclass(frozen=True)
class Row:
    """One quantity: ours, ours with FEBio's bending and contact, and FEBio's, None where no figure
    of it is published.  `difference` is relative (of a displacement: to the largest of the model's
    nodes)."""

    quantity: str
    ours: float
    alike: float | None = None
    febio: float | None = None
    difference: float = 0.0
    difference_alike: float = 0.0

    @property
    def verdict(self) -> str:
        if self.febio is None:
            return "no figure"
        if abs(self.difference) <= TOLERANCE:
            return "agrees"
        return "formulation" if abs(self.difference_alike) <= TOLERANCE else "differs"


@dataclass(frozen=True)
class Measured:
    """One model solved in a process of its own: values by name, the deepest penetration (um), CPU
    seconds of the solve and of the set-up (file, model, distances of bones), peak memory of the
    imports alone and of all, MB."""

    values: dict[str, float]
    penetration: float
    solve_s: float
    setup_s: float
    import_mb: float
    peak_mb: float
    iterations: int
    linear_solver: str


@dataclass(frozen=True)
class Comparison:
    """A model's rows and costs; `febio_s` is FEBio's CPU time scaled to this machine by the
    reference job, None where that is not there."""

    model: str
    rows: tuple[Row, ...]
    ours: Measured
    published: Published | None = None
    febio_s: float | None = None

    @property
    def share(self) -> float | None:
        """Our CPU time over FEBio's."""
        return None if self.febio_s is None else self.ours.solve_s / self.febio_s


def models_in(folder: Path) -> list[Path]:
    """The FEBio files of a folder.  Raises InputError where there are none."""
    found = sorted(folder.glob("*.feb"))
    if not found:
        raise InputError(f"{folder}: holds no FEBio files (*.feb)")
    return found


def quantities(job: Job, state: JobState, published: Published | None) -> dict[str, float]:
    """What is compared, by name, mm and N: what is published, else the node that moves farthest and
    the contact on all bodies."""
    index = {int(n): i for i, n in enumerate(job.node_ids)}
    if published is None:
        wanted = [(farthest(job, state)[1], i) for i in range(3)]
        touched = np.flatnonzero(state.contact[:, 2])
    else:
        nodes = published.displacement
        missing = [n for n in nodes if n not in index]
        if missing:
            raise InputError(f"{job.name}: has no node {missing[0]}; it is not the published model")
        wanted = [(n, i) for n in nodes for i in range(3) if nodes[n][i] != 0.0]
        touched = np.arange(len(published.contact))
    u = 1e3 * displacement(job, state)
    out = {f"u{'xyz'[i]} of node {n} (mm)": float(u[index[n], i]) for n, i in wanted}
    for i in touched:
        out[f"contact z on {state.model.bodies[i]} (N)"] = float(state.contact[i, 2])
    if not state.spring_forces:
        return out
    force = np.concatenate(state.spring_forces)
    out["largest spring (N)"] = float(force.max(initial=0.0))
    out["sum of springs (N)"] = float(force.sum())
    out["active springs"] = float((force > 0).sum())
    return out


def _figures(published: Published) -> list[float]:
    """In the order of `quantities`."""
    moved = [v for u in published.displacement.values() for v in u if v != 0.0]
    return [*moved, *published.contact, published.largest, published.total, float(published.active)]


def rows(published: Published | None, ours: dict[str, float], alike: dict[str, float]) -> list[Row]:
    """One for each quantity."""
    if published is None:
        return [Row(name, value) for name, value in ours.items()]
    largest = max(np.linalg.norm(u) for u in published.displacement.values())
    out = []
    for name, figure in zip(ours, _figures(published), strict=True):
        scale = float(largest) if name.startswith("u") else abs(figure)
        a, b = ours[name], alike[name]
        out.append(Row(name, a, b, figure, (a - figure) / scale, (b - figure) / scale))
    return out


def compare(folder: Path, spacing: float = 0.25e-3) -> Iterator[Comparison]:
    """All models of a folder, each solved in a process of its own with one thread: once as the
    solver is, which is timed, and, where FEBio's figures are published, once as FEBio does.

    Raises InputError where the folder holds none, and CosimError where one is not solved."""
    for path in models_in(folder):
        seconds = reference_seconds(folder)  # beside each solve: machines have moods
        ours = measured(path, False, spacing)
        published = PUBLISHED.get(path.stem)
        if published is None:
            yield Comparison(path.stem, tuple(rows(None, ours.values, {})), ours)
            continue
        alike = measured(path, True, spacing)
        made = tuple(rows(published, ours.values, alike.values))
        scaled = None if seconds is None else seconds / REFERENCE_S * published.cpu_s
        yield Comparison(path.stem, made, ours, published, scaled)


def reference_seconds(folder: Path) -> float | None:
    """CPU seconds of the folder's reference job on this machine, one thread; None where the folder
    has none."""
    script = folder / REFERENCE_JOB
    if not script.is_file():
        return None
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=False
    )
    try:
        return float(done.stdout)
    except ValueError:
        raise InputError(f"{script}: expected it to print its CPU seconds") from None


def measured(path: Path, as_febio: bool, spacing: float) -> Measured:
    """A model solved in a process of its own.  Raises CosimError where that fails."""
    one = {"FE_SOLVER_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    one |= {"OPENBLAS_NUM_THREADS": "1"}
    call = [sys.executable, "-m", __name__, str(path), str(int(as_febio)), repr(spacing)]
    done = subprocess.run(
        call, capture_output=True, text=True, check=False, env={**os.environ, **one}
    )
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise (InputError if done.returncode == 2 else CosimError)(reason)
    return Measured(**json.loads(done.stdout))


def _main(path: str, as_febio: str, spacing: str) -> None:
    """The process of one model: prints a `Measured` as JSON."""
    from ..bench import PULL, rod_sheet
    from ..job_solve import solve_job
    from ..linear_algebra import chosen
    from ..newton import NewtonOptions, solve
    from ..verification.sheets import at_rest
    from .read import read_feb

    warm = rod_sheet(64)  # compiles the kernels, or takes them from their cache
    solve(warm, at_rest(warm), PULL, NewtonOptions(tolerance=1e-8))
    imports = peak_mb()
    began = time.process_time()
    job = read_feb(path)
    read = time.process_time() - began
    # FEBio's figures are of a penalty without augmentation, so ours are, too
    options = JobOptions(None, spacing=float(spacing), as_febio=bool(int(as_febio)))
    result = solve_job(job, options=options)
    last = result.states[-1]
    values = quantities(job, last, PUBLISHED.get(Path(path).stem))
    made = Measured(
        values,
        1e6 * last.penetration,
        result.effort.cpu_s,
        result.setup_s + read,
        imports,
        peak_mb(),
        result.effort.iterations,
        chosen(),
    )
    print(json.dumps(asdict(made)))


def peak_mb() -> float:
    """Largest memory of this process so far, MB (1e6 bytes)."""
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


if __name__ == "__main__":
    try:
        _main(*sys.argv[1:])
    except CosimError as error:
        print(error, file=sys.stderr)
        sys.exit(2 if isinstance(error, InputError) else 1)
