"""Our answers beside FEBio's published ones.

The figures are those of FEBio 4.11 (one thread, PARDISO) for five models of a sheet over three
bones, by the names of their files; elements `q4ans`, from the README that comes with the models.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.port import CosimError, InputError

from .job import Job
from .job_model import JobOptions
from .job_results import displacement
from .job_solve import JobState

SOURCE = "FEBio 4.11, q4ans shells, one thread: the models' README"
TOLERANCE = 0.03
REFERENCE_S = 0.95
"""CPU seconds of the reference job on FEBio's machine (0.91 to 1.06)."""
REFERENCE_JOB = "reference_job.py"


@dataclass(frozen=True)
class Published:
    """FEBio's last state: displacements by node number (mm), contact resultants along z on the
    first two bodies (N), the springs' largest force and sum (N) and how many act, CPU seconds, peak
    memory (MB, where it is stated)."""

    displacement: Mapping[int, tuple[float, float, float]]
    contact: tuple[float, ...]
    largest: float
    total: float
    active: int
    cpu_s: float
    peak_mb: float | None


PUBLISHED = {
    "free_iso_2000": Published(
        {
            11: (-0.846692, 0.0, -1.490595),
            1: (-0.739305, 0.202972, -1.706770),
            1271: (-0.003352, 0.0, -0.155221),
        },
        (),
        6.458,
        6.46,
        1,
        25.1,
        240,
    ),
    "hood_iso_500": Published(
        {
            6: (-0.436311, 0.0, 0.073390),
            1: (-0.469208, -0.009983, 0.125914),
            336: (0.000708, 0.0, 0.011817),
        },
        (-22.463, -8.229),
        3.570,
        36.88,
        91,
        1.5,
        159,
    ),
    "hood_iso_2000": Published(
        {
            11: (-0.489158, 0.0, 0.061405),
            1: (-0.520013, 0.000369, 0.105599),
            1271: (0.000043, 0.0, 0.001317),
        },
        (-18.261, -2.503),
        3.623,
        25.24,
        91,
        8.5,
        240,
    ),
    "hood_tiMR_500": Published(
        {
            6: (-0.447081, 0.0, 0.022884),
            1: (-0.444215, 0.013154, 0.059901),
            336: (0.000239, 0.0, 0.004860),
        },
        (-11.998, -2.657),
        5.825,
        21.55,
        21,
        1.3,
        159,
    ),
    "hood_flex30_500": Published(
        {
            6: (1.709827, 0.0, -0.020983),
            1: (1.601530, 0.033101, 0.022085),
            336: (2.605416, 0.0, -2.786901),
        },
        (-58.731, -22.921),
        22.659,
        98.92,
        21,
        25.1,
        159,
    ),
}


@dataclass(frozen=True)
class Row:
    """One quantity: ours, ours with FEBio's bending and contact, and FEBio's.  `difference` is
    relative (of a displacement: to the largest of the model's nodes)."""

    quantity: str
    ours: float
    alike: float
    febio: float
    difference: float
    difference_alike: float

    @property
    def verdict(self) -> str:
        if abs(self.difference) <= TOLERANCE:
            return "agrees"
        return "formulation" if abs(self.difference_alike) <= TOLERANCE else "differs"


@dataclass(frozen=True)
class Measured:
    """One model solved in a process of its own: CPU seconds of the solve and of the set-up (file,
    model, distances of bones), peak memory of the imports alone and of all, MB."""

    values: dict[str, float]
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
    febio_s: float | None
    febio_mb: float | None

    @property
    def share(self) -> float | None:
        """Our CPU time over FEBio's."""
        return None if self.febio_s is None else self.ours.solve_s / self.febio_s


def known_models(folder: Path) -> list[Path]:
    """Files of the folder whose names are among the published models.  Raises InputError where
    there are none."""
    found = [folder / f"{name}.feb" for name in PUBLISHED]
    found = [path for path in found if path.is_file()]
    if not found:
        raise InputError(
            f"{folder}: holds none of the models with published figures: "
            f"{', '.join(f'{name}.feb' for name in PUBLISHED)}"
        )
    return found


def quantities(job: Job, state: JobState, published: Published) -> dict[str, float]:
    """What is compared, by name, mm and N."""
    index = {int(n): i for i, n in enumerate(job.node_ids)}
    missing = [n for n in published.displacement if n not in index]
    if missing:
        raise InputError(f"{job.name}: has no node {missing[0]}; it is not the published model")
    u = 1e3 * displacement(job, state)
    out = {
        f"u{axis} of node {n} (mm)": float(u[index[n], i])
        for n in published.displacement
        for i, axis in enumerate("xyz")
        if published.displacement[n][i] != 0.0
    }
    for i in range(len(published.contact)):
        out[f"contact z on {job.bodies[i].name} (N)"] = float(state.contact[i, 2])
    force = np.concatenate(state.spring_forces)
    out["largest spring (N)"], out["sum of springs (N)"] = float(force.max()), float(force.sum())
    out["active springs"] = float((force > 0).sum())
    return out


def _figures(published: Published) -> list[float]:
    """In the order of `quantities`."""
    moved = [v for u in published.displacement.values() for v in u if v != 0.0]
    return [*moved, *published.contact, published.largest, published.total, float(published.active)]


def rows(published: Published, ours: dict[str, float], alike: dict[str, float]) -> list[Row]:
    """One for each quantity."""
    largest = max(np.linalg.norm(u) for u in published.displacement.values())
    out = []
    for name, figure in zip(ours, _figures(published), strict=True):
        scale = float(largest) if name.startswith("u") else abs(figure)
        a, b = ours[name], alike[name]
        out.append(Row(name, a, b, figure, (a - figure) / scale, (b - figure) / scale))
    return out


def compare(folder: Path, spacing: float = 0.5e-3) -> Iterator[Comparison]:
    """All known models of a folder, each solved in a process of its own with one thread: once as
    the solver is, which is timed, and once as FEBio does.

    Raises InputError where the folder holds none, and CosimError where one is not solved."""
    models = known_models(folder)
    for path in models:
        published = PUBLISHED[path.stem]
        seconds = reference_seconds(folder)  # beside each solve: machines have moods
        scale = None if seconds is None else seconds / REFERENCE_S
        ours = measured(path, False, spacing)
        alike = measured(path, True, spacing)
        made = tuple(rows(published, ours.values, alike.values))
        febio = None if scale is None else scale * published.cpu_s
        yield Comparison(path.stem, made, ours, febio, published.peak_mb)


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
        last = done.stderr.strip().splitlines() or ["no reason given"]
        raise CosimError(f"{path}: {last[-1]}")
    return Measured(**json.loads(done.stdout))


def _main(path: str, as_febio: str, spacing: str) -> None:
    """The process of one model: prints a `Measured` as JSON."""
    from .bench import PULL, rod_sheet
    from .feb_read import read_feb
    from .job_solve import solve_job
    from .linear_algebra import chosen
    from .newton import NewtonOptions, solve
    from .verification.sheets import at_rest

    warm = rod_sheet(64)  # compiles the kernels, or takes them from their cache
    solve(warm, at_rest(warm), PULL, NewtonOptions(tolerance=1e-8))
    imports = peak_mb()
    began = time.process_time()
    job = read_feb(path)
    read = time.process_time() - began
    options = JobOptions(spacing=float(spacing))
    if int(as_febio):
        options = replace(options, as_febio=True, penetration=None)
    result = solve_job(job, options=options)
    values = quantities(job, result.states[-1], PUBLISHED[job.name])
    made = Measured(
        values,
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


def as_record(c: Comparison) -> dict[str, Any]:
    """For JSON."""
    verdicts = [{**asdict(r), "verdict": r.verdict} for r in c.rows]
    return {**asdict(c), "rows": verdicts, "share": c.share, "source": SOURCE}


if __name__ == "__main__":
    try:
        _main(*sys.argv[1:])
    except CosimError as error:
        sys.exit(str(error))
