"""Stand-ins for the process of a calibration."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any


def give_model(pipe: Any, task: Any) -> None:
    path = Path(task.store) / "model.json"
    while not path.exists():
        time.sleep(0.05)
    pipe.send(("done", json.loads(path.read_text(encoding="utf-8"))))


def wait(pipe: Any, task: Any) -> None:  # noqa: ARG001
    time.sleep(600)


def die(pipe: Any, task: Any) -> None:  # noqa: ARG001
    os._exit(3)
