"""A few of the kills that `python -m tests.hostile.kills` does by the hundred."""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from tests.hostile.kills import JOBS, kill_jobs


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize("job", JOBS)
def test_kills_leave_nothing_and_change_nothing(job: str) -> None:
    with TemporaryDirectory() as folder:  # of a short path, which sockets need
        kills = kill_jobs(Path(folder), 4, [job])
    assert any(kill.was_running for kill in kills)
    assert not [kill for kill in kills if kill.faults]
