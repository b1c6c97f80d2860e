"""Hypothesis without deadlines: how long an example takes says how busy the machine is; and Ctrl-C
as it is at a prompt, since a shell lets what it starts in the background ignore it."""

from __future__ import annotations

import signal

from hypothesis import settings

settings.register_profile("no deadlines", deadline=None)
settings.load_profile("no deadlines")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
