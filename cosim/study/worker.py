"""The process that solves runs for a worker: tasks come as lines of JSON, verdicts go back.

A solve may hang or crash in compiled code, where nothing but ending the process helps; so it has
one of its own.  It ends with the worker, when its input does."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING

from cosim.case.cache_key import code_version
from cosim.errors import InputError
from cosim.study.store import Store
from cosim.study.task import Task, run_task

if TYPE_CHECKING:
    from cosim.solve.session import Session


def main() -> None:
    """Says when it is ready; then until the input ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints is no answer
    lines: SimpleQueue[str] = SimpleQueue()
    Thread(target=_listen, args=(lines,), daemon=True).start()
    stores: dict[str, Store] = {}
    session = import_module("cosim.pipeline").Session()  # a run's time is that of solving alone
    print("ready", file=answers, flush=True)
    while True:
        print(_answer(lines.get(), stores, session), file=answers, flush=True)


def _listen(lines: SimpleQueue[str]) -> None:
    for line in sys.stdin:
        lines.put(line)
    os._exit(0)  # the worker is gone: a run that nobody waits for ends here


def _answer(line: str, stores: dict[str, Store], session: Session) -> str:
    values = json.loads(line)
    arrays = values["arrays"]
    values["arrays"] = tuple(arrays) if isinstance(arrays, list) else arrays
    task = Task(**values)
    if task.code != code_version():
        fault = (
            f"a worker has cosim {code_version()}, this study is for {task.code}: install the same "
            "on both"
        )
        return json.dumps({"fault": fault})
    try:
        store = stores.setdefault(task.store, Store(Path(task.store)))
        return json.dumps(asdict(run_task(task, store, session)))
    except InputError as error:
        return json.dumps({"fault": str(error)})


if __name__ == "__main__":
    main()
