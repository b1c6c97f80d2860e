"""Reading a mesh file of any format that meshio knows."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cosim.port import InputError
from cosim.vtu import read_vtu

if TYPE_CHECKING:
    from meshio import Mesh


def read_mesh_file(path: Path) -> Mesh:
    """The mesh of a file.  meshio's readers end in many ways on a broken file, some by leaving the
    program.

    Raises InputError where the file cannot be read."""
    import meshio

    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    if path.suffix.lower() == ".vtu":
        return read_vtu(path)
    try:
        with np.errstate(all="ignore"), redirect_stdout(StringIO()):  # it prints empty lines
            return meshio.read(path)
    except SystemExit as end:
        raise InputError(f"{path}: meshio knows no format for it, or finds it broken") from end
    except (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError) as error:
        raise InputError(f"{path}: meshio cannot read it: {error!r}") from error
    except (OSError, RuntimeError, ValueError, meshio.ReadError) as error:
        text = str(error) or type(error).__name__
        raise InputError(f"{path}: meshio cannot read it: {text}") from error
