"""Workers that die at a job, take too long for it, or do it in no time."""

from __future__ import annotations

import json
import os
import pickle
import time
from pathlib import Path
from typing import Any


def misbehave(pipe: Any, scratch: str) -> None:
    folder = Path(scratch).parent
    count = folder / "count"
    pipe.send(("ready", None))
    while True:
        pipe.poll(None)
        number = int(count.read_text()) if count.exists() else 0
        count.write_text(str(number + 1))
        if number == 0:
            os._exit(9)
        if number == 1:
            time.sleep(600)
        if not pipe.recv_bytes():
            return
        pipe.send(("done", json.loads((folder / "run.json").read_text())))


def end_at_once(pipe: Any, scratch: str) -> None:  # noqa: ARG001
    pipe.send(("ready", None))
    pipe.poll(None)
    os._exit(9)


def never_end(pipe: Any, scratch: str) -> None:  # noqa: ARG001
    pipe.send(("ready", None))
    time.sleep(600)


def give_result(pipe: Any, scratch: str) -> None:
    """Do each job in no time, until the pipe is closed."""
    pipe.send(("ready", None))
    result = json.loads((Path(scratch).parents[1] / "result.json").read_text())
    while pipe.poll(None) and pipe.recv_bytes() != pickle.dumps(None):
        pipe.send(("done", result))
