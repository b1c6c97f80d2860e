"""Our answers and costs beside FEBio's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.port import ConvergenceError, CosimError, InputError

from ..job import Job
from ..job_model import JobOptions
from ..job_results import displacement
from ..job_solve import JobResult, JobState
from .figures import PUBLISHED, REFERENCE_S, Published
from .remade import not_covered, remade

Array = NDArray[np.float64]

TOLERANCE = 0.03
REFERENCE_JOB = "reference_job.py"


@dataclass(frozen=True)
class Row:
    """One quantity by our solver, by our solver with FEBio's bending and contact (`alike`), by
    FEBio's element and contact made anew (`remade`), and FEBio's own figure; None where there is
    none.  `scale` is what differences are divided by: of a displacement the largest of the model's
    nodes, else the figure."""

    quantity: str
    ours: float
    alike: float | None = None
    remade: float | None = None
    febio: float | None = None
    scale: float = 1.0

    @property
    def difference(self) -> float | None:
        """Of ours from FEBio's figure, relative."""
        return self.off(self.ours)

    def off(self, value: float | None) -> float | None:
        """A value's difference from FEBio's figure; None where one of them is not there."""
        if value is None or self.febio is None:
            return None
        return (value - self.febio) / self.scale

    @property
    def verdict(self) -> str:
        """Of ours, and where that differs of the nearest to FEBio's formulation that there is."""
        if self.febio is None:
            return "no figure"
        nearest = self.alike if self.remade is None else self.remade
        for value, word in ((self.ours, "agrees"), (nearest, "formulation")):
            off = self.off(value)
            if off is not None and abs(off) <= TOLERANCE:
                return word
        return "differs"


@dataclass(frozen=True)
class Again:
    """A model with FEBio's element and contact made anew: values by name, the deepest penetration
    of a Gauss point (um), CPU seconds from our solution on, iterations; or why it is missing."""

    values: dict[str, float]
    penetration: float = 0.0
    cpu_s: float = 0.0
    iterations: int = 0
    missing: str = ""


@dataclass(frozen=True)
class Measured:
    """One model solved in a process of its own: values by name, the deepest penetration (um), CPU
    seconds of the solve and of the set-up (file, model, distances of bones), peak memory of the
    imports alone and of all, MB; `again` where it was solved as FEBio does."""

    values: dict[str, float]
    penetration: float
    solve_s: float
    setup_s: float
    import_mb: float
    peak_mb: float
    iterations: int
    linear_solver: str
    again: Again | None = None


@dataclass(frozen=True)
class Comparison:
    """A model's rows and costs; `febio_s` is FEBio's CPU time scaled to this machine by the
    reference job, None where that is not there."""

    model: str
    rows: tuple[Row, ...]
    ours: Measured
    published: Published | None = None
    febio_s: float | None = None
    again: Again | None = None

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
    moved, contact = displacement(job, state), state.contact[: len(job.bodies)]
    return _named(job, published, moved, contact, state.spring_forces)


def _named(
    job: Job,
    published: Published | None,
    displacement: Array,
    contact: Array,
    springs: Sequence[Array],
) -> dict[str, float]:
    """From displacements (n, 3) m, contact forces (nb, 3) N and each spring set's forces (k,) N."""
    index = {int(n): i for i, n in enumerate(job.node_ids)}
    if published is None:
        farthest = int(job.node_ids[np.linalg.norm(displacement, axis=1).argmax()])
        wanted = [(farthest, i) for i in range(3)]
        touched = np.flatnonzero(contact[:, 2])
    else:
        nodes = published.displacement
        missing = [n for n in nodes if n not in index]
        if missing:
            raise InputError(f"{job.name}: has no node {missing[0]}; it is not the published model")
        wanted = [(n, i) for n in nodes for i in range(3) if nodes[n][i] != 0.0]
        touched = np.arange(len(published.contact))
    u = 1e3 * displacement
    out = {f"u{'xyz'[i]} of node {n} (mm)": float(u[index[n], i]) for n, i in wanted}
    for i in touched:
        out[f"contact z on {job.bodies[i].name} (N)"] = float(contact[i, 2])
    if not springs:
        return out
    force = np.concatenate(springs)
    out["largest spring (N)"] = float(force.max(initial=0.0))
    out["sum of springs (N)"] = float(force.sum())
    out["active springs"] = float((force > 0).sum())
    return out


def _figures(published: Published) -> list[float]:
    """In the order of `quantities`."""
    moved = [v for u in published.displacement.values() for v in u if v != 0.0]
    return [*moved, *published.contact, published.largest, published.total, float(published.active)]


def rows(
    published: Published | None,
    ours: dict[str, float],
    alike: dict[str, float],
    again: dict[str, float] | None = None,
) -> list[Row]:
    """One for each quantity."""
    if published is None:
        return [Row(name, value) for name, value in ours.items()]
    largest = float(max(np.linalg.norm(u) for u in published.displacement.values()))
    out = []
    for name, figure in zip(ours, _figures(published), strict=True):
        scale = largest if name.startswith("u") else abs(figure)
        out.append(Row(name, ours[name], alike[name], (again or {}).get(name), figure, scale))
    return out


def compare(folder: Path, spacing: float = 0.25e-3) -> Iterator[Comparison]:
    """All models of a folder, each solved in a process of its own with one thread: once as the
    solver is, which is timed, and, where FEBio's figures are published, once as FEBio does and from
    there with FEBio's element and contact made anew.

    Raises InputError where the folder holds none, and CosimError where one is not solved."""
    for path in models_in(folder):
        seconds = reference_seconds(folder)  # beside each solve: machines have moods
        ours = measured(path, False, spacing)
        published = PUBLISHED.get(path.stem)
        if published is None:
            yield Comparison(path.stem, tuple(rows(None, ours.values, {})), ours)
            continue
        alike = measured(path, True, spacing)
        again = alike.again
        found = rows(published, ours.values, alike.values, again.values if again else None)
        scaled = None if seconds is None else seconds / REFERENCE_S * published.cpu_s
        yield Comparison(path.stem, tuple(found), ours, published, scaled, again)


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


def measured(path: Path, as_febio: bool, spacing: float) -> Measured:
    """A model solved in a process of its own.  Raises CosimError where that fails."""
    one = {"FE_SOLVER_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    one |= {"OPENBLAS_NUM_THREADS": "1"}
    call = [sys.executable, "-m", __name__, str(path), str(int(as_febio)), repr(spacing)]
    done = subprocess.run(
        call,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
        env={**os.environ, **one},
    )
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise (InputError if done.returncode == 2 else CosimError)(reason)
    found = json.loads(done.stdout)
    again = found.pop("again")
    return Measured(**found, again=None if again is None else Again(**again))


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
    job = replace(read_feb(path), as_febio=bool(int(as_febio)))
    read = time.process_time() - began
    # FEBio's figures are of a penalty without augmentation, so ours are, too
    result = solve_job(job, options=JobOptions(None, spacing=float(spacing)))
    last, published = result.states[-1], PUBLISHED.get(Path(path).stem)
    values = quantities(job, last, published)
    made = Measured(
        values,
        1e6 * last.penetration,
        result.effort.cpu_s,
        result.setup_s + read,
        imports,
        peak_mb(),
        result.effort.iterations,
        chosen(),
        made_again(result, published) if job.as_febio else None,
    )
    print(json.dumps(asdict(made)))


def made_again(result: JobResult, published: Published | None) -> Again:
    """A job solved `as_febio`, with FEBio's element and contact; or why not."""
    reason = not_covered(result.job)
    if reason is not None:
        return Again({}, missing=f"the model {reason}")
    began = time.process_time()
    try:
        found = remade(result)
    except ConvergenceError as error:
        return Again({}, missing=str(error))
    spent, job = time.process_time() - began, result.job
    moved = found.x - job.points
    values = _named(job, published, moved, found.contact, found.spring_forces)
    return Again(values, 1e6 * found.penetration, spent, found.iterations)


def peak_mb() -> float:
    """Largest memory of this process so far, MB (1e6 bytes)."""
    if sys.platform == "win32":
        import psutil

        return float(psutil.Process().memory_info().peak_wset) / 1e6
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


if __name__ == "__main__":
    try:
        _main(*sys.argv[1:])
    except CosimError as error:
        print(error, file=sys.stderr)
        sys.exit(2 if isinstance(error, InputError) else 1)
