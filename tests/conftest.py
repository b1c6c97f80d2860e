"""Hypothesis without deadlines: how long an example takes says how busy the machine is; and Ctrl-C
as it is at a prompt, since a shell lets what it starts in the background ignore it.  Garbage is not
looked for among what collecting the tests leaves, which all lives to the end, and less often
elsewhere."""

from __future__ import annotations

import gc
import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

from tests.helpers.rows import Judge, add_options, judge_of, show

settings.register_profile("no deadlines", deadline=None)
settings.load_profile("no deadlines")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


pytest_addoption = add_options


@pytest.fixture
def judge(request: pytest.FixtureRequest) -> Judge:
    """What judges rows of a proof, and leaves them for `--table` and `--rows`."""
    return judge_of(request)


def pytest_terminal_summary(terminalreporter, config) -> None:
    reports = [r for kind in ("passed", "failed") for r in terminalreporter.stats.get(kind, ())]
    show(reports, config)


@pytest.hookimpl(hookwrapper=True)
def pytest_collection() -> Iterator[None]:
    gc.disable()
    yield
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000)
    gc.enable()


@pytest.fixture
def hears_hangups() -> Iterator[None]:
    """Hear SIGHUP in what a test starts, also where the tests run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)
