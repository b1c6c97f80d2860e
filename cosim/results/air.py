"""The pneumatic cylinders of a motion: their history as arrays, their end in numbers."""

from __future__ import annotations

from typing import Any

from cosim.port import Array


def air_data(names: tuple[str, ...], drive: Array) -> tuple[dict[str, Any], dict[str, Any]]:
    """Variables and coordinates of a data set from (n + 1, nc, 2): V commanded and Pa above the
    atmosphere; none of either without a cylinder."""
    if not names:
        return {}, {}
    over_time = ("time", "cylinder")
    command = (over_time, drive[..., 0], {"units": "V", "long_name": "valve voltage commanded"})
    above = {"units": "Pa", "long_name": "pressure above the atmosphere"}
    return {"command": command, "pressure": (over_time, drive[..., 1], above)}, {
        "cylinder": list(names)
    }


def air_end(names: tuple[str, ...], drive: Array) -> dict[str, dict[str, float]]:
    """By tendon, from (nc, 2) at the end."""
    return {
        name: {"command_V": float(volts), "pressure_kPa": 1e-3 * float(pressure)}
        for name, (volts, pressure) in zip(names, drive, strict=True)
    }
