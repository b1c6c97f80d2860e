"""What a unit whose state can be taken has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cosim.fmu_export.state import SerialisedState, Snapshot

if TYPE_CHECKING:
    from cosim.fmu_export.run import UnitRun


class Stateful:
    """The hooks by which pythonfmu and pythonfmu3 get, set, write and read states."""

    run: UnitRun

    def _get_fmu_state(self) -> Snapshot:
        return self.run.snapshot()

    def _set_fmu_state(self, state: Any) -> None:
        self.run.restore(state)

    @staticmethod
    def _fmu_state_to_bytes(state: Any) -> bytes:
        return state.to_bytes() if isinstance(state, Snapshot | SerialisedState) else b""

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> SerialisedState:
        """The state of these bytes.  They are read when it is set: a fault fails the next step."""
        return SerialisedState(bytes(state))
