"""What the faces of both versions of FMI have in common: states, and initialization."""

from __future__ import annotations

from typing import Any

from cosim.errors import ConvergenceError
from cosim.fmu_export.run import UnitRun, fault_of
from cosim.fmu_export.state import SerialisedState, Snapshot


class Stateful:
    """The hooks by which pythonfmu and pythonfmu3 get, set, write and read states, and initialise.

    These tools have no other way than an exception to say that a unit cannot be initialised; their
    binaries make the error of the standard of it."""

    run: UnitRun

    def enter_initialization_mode(self) -> None:
        """Outputs follow from the inputs from here on."""
        self.run.enter_initialization()

    def exit_initialization_mode(self) -> None:
        """Compute the first outputs.  Raises ConvergenceError where the inputs have no answer."""
        if fault := self.run.exit_initialization():
            raise ConvergenceError(fault)

    def _get_fmu_state(self) -> Snapshot:
        return self.run.snapshot()

    def _set_fmu_state(self, state: Any) -> None:
        self.run.restore(state)

    @staticmethod
    def _fmu_state_to_bytes(state: Any) -> bytes:
        out = b""

        def write() -> None:
            nonlocal out
            out = state.to_bytes() if isinstance(state, Snapshot | SerialisedState) else b""

        fault_of(write)  # no bytes are no state, which their reader says
        return out

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> SerialisedState:
        """The state of these bytes.  They are read when it is set: a fault fails the next step."""
        return SerialisedState(bytes(state))
