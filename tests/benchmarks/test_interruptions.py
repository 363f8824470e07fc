from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

WRITER = """
import os, sys
from pathlib import Path
from ballscrew.base.files import write_texts
from benchmarks.interruptions import Interruptions
folder, report = map(Path, sys.argv[1:])
Interruptions(folder, ("a", "b"), report, 3, fillable=False).install()
write_texts([(folder / "a", ["new"]), (folder / "b", ["new"])])
os._exit(0)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a system that can fork")
def test_a_writer_killed_at_any_call_leaves_the_old_file_or_the_new(tmp_path: Path) -> None:
    folder, report = tmp_path / "folder", tmp_path / "report.json"
    folder.mkdir()
    for name in "ab":
        (folder / name).write_text("old", encoding="utf-8")
    subprocess.run([sys.executable, "-c", WRITER, folder, report], check=True)  # noqa: S603  this Python
    endings = json.loads(report.read_text(encoding="utf-8"))
    killed = [each for each in endings if each["status"] == -9]
    assert len([each for each in killed if each["kind"] == "call"]) >= 10
    found = {state for each in endings for state in each["states"].values()}
    assert found == {"old", "new"}
    assert not any(each["others"] for each in endings)
    assert any(each["left"] for each in killed)
    assert endings[0]["left"] == []  # what an earlier one had left is swept
