"""How large a checkpoint may be that is read."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.coupling import checkpoint
from cosim.coupling.checkpoint import NAME, read_checkpoint
from cosim.errors import InputError


def test_a_checkpoint_beyond_the_bound_is_not_read(tmp_path, monkeypatch):
    """Up to it the file is read, and found to be no checkpoint."""
    np.savez(tmp_path / NAME, x=np.zeros(100))
    for bound, says in ((1 << 20, "its digest differs"), (100, "larger than it is")):
        monkeypatch.setattr(checkpoint, "MOST_BYTES", bound)
        with pytest.raises(InputError, match=says):
            read_checkpoint(tmp_path, "", None, {})
