"""Simulators of others that step an exported unit: the same unit, input and steps in each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

Master = Callable[[Path, Mapping[str, float], tuple[str, ...], float, int], list[float]]
"""Of a unit's file, its inputs by name, the outputs asked for, a step (s) and their number: the
outputs at the end."""


def by_fmpy(
    unit: Path, inputs: Mapping[str, float], asked: tuple[str, ...], step: float, steps: int
) -> list[float]:
    """FMPy's `simulate_fmu` (Dassault Systemes), in Python."""
    from fmpy import simulate_fmu

    end = step * steps
    seen = simulate_fmu(
        str(unit), stop_time=end, step_size=step, output_interval=step, start_values=dict(inputs),
        output=list(asked),
    )  # fmt: skip
    return [float(seen[name][-1]) for name in asked]


def by_libcosim(
    unit: Path, inputs: Mapping[str, float], asked: tuple[str, ...], step: float, steps: int
) -> list[float]:
    """libcosim of the Open Simulation Platform (DNV, SINTEF), in C++ by its libcosimpy."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(step_size=round(step * 1e9))
    slave = execution.add_local_slave(CosimLocalSlave(str(unit), "finger"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    place = {}
    for variable in execution.slave_variables(slave):
        place[variable.name.decode()] = variable.reference
    for name, value in inputs.items():
        execution.real_initial_value(slave, place[name], value)
    execution.step(step_count=steps)
    return list(observer.last_real_values(slave, [place[name] for name in asked]))


def by_ecos(
    unit: Path, inputs: Mapping[str, float], asked: tuple[str, ...], step: float, steps: int
) -> list[float]:
    """Ecos (NTNU), in C++ by its ecospy, which needs libtbb."""
    from ecospy import EcosSimulation, EcosSimulationStructure

    with EcosSimulationStructure() as structure:
        structure.add_model("finger", str(unit))
        structure.add_parameter_set(
            "inputs", {f"finger::{name}": value for name, value in inputs.items()}
        )
        with EcosSimulation(structure=structure, step_size=step) as simulation:
            simulation.init(parameter_set="inputs")
            simulation.step(steps)
            return [simulation.get_real(f"finger::{name}") for name in asked]


MASTERS: dict[str, tuple[str, Master]] = {
    "FMPy": ("fmpy", by_fmpy),
    "libcosim": ("libcosimpy", by_libcosim),
    "Ecos": ("ecospy", by_ecos),
}
"""By name, the module that must be there, and how it runs a unit."""
