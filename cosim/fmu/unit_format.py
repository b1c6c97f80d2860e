"""The account of itself in an FMU that this program wrote, and which version can run it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cosim.errors import InputError
from cosim.version import FMU_FORMAT, __version__

ABOUT, LOADED = "about.json", "slavemodule.txt"
"""Files of a unit's resources: which part of the case it is, by which version and in which format;
the name of the script that its loader runs."""
SCRIPT = {2: "cosim_fmu2", 3: "cosim_fmu3"}
"""By version of FMI, the name of the script in the units that we write."""


def read_about(resources: Path) -> Mapping[str, Any]:
    """The unit's own account in its folder `resources`.  Raises InputError for a unit of another
    format or version than this program runs."""
    try:
        about: Mapping[str, Any] = json.loads((resources / ABOUT).read_text(encoding="utf-8"))
        version, unit_format = str(about["version"]), about.get("format", 1)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(
            f"this FMU's {ABOUT} does not describe a unit of cosim-hand ({error!r}); write the FMU "
            "anew with `cosim export`"
        ) from error
    if (unit_format, version) != (FMU_FORMAT, __version__):
        raise InputError(
            f"this FMU was written by cosim-hand {version} in format {unit_format}, and this Python"
            f" has cosim-hand {__version__}, which runs format {FMU_FORMAT}; write the FMU anew "
            "with `cosim export`, or install the cosim-hand that wrote it"
        )
    return about


def check_if_ours(resources: Path) -> bool:
    """Whether cosim-hand wrote a unit, which then has this format and version.
    Raises InputError."""
    try:
        script = (resources / LOADED).read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return False
    if script in SCRIPT.values():
        read_about(resources)
        return True
    return False
