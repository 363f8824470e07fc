"""``ballscrew amend``."""

from __future__ import annotations

from pathlib import Path

from tests.monitoring.histories import history

from ballscrew import Run
from ballscrew.base.jsonfile import write_json
from ballscrew.recording.quality.finding import Quality


def test_the_command_replaces_the_file_or_writes_another(ballscrew, tmp_path: Path) -> None:
    path, other = tmp_path / "run.json", tmp_path / "other.json"
    run = history([0.0])[0]
    path.write_text(write_json(run.to_json()), encoding="utf-8")
    outcome = ballscrew("amend", path, "--measured-at", "2026-02-01T08:00Z", "--out", other)
    assert (outcome.status, outcome.err) == (0, "")
    assert Run.read(path).id == run.id
    assert ballscrew("amend", path, "--measured-at", "2026-02-01T08:00Z", "--json").status == 0
    assert Run.read(path) == Run.read(other)
    assert ballscrew("amend", path).status == 2


def test_the_verdict_of_the_amended_run_is_printed_with_its_reasons(ballscrew, tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    run = history([0.0], quality=Quality("bad", ("the nut [acc1] is clipped",)))[0]
    path.write_text(write_json(run.to_json()), encoding="utf-8")
    outcome = ballscrew("amend", path, "--measured-at", "2026-02-01T08:00Z")
    assert outcome.status == 1
    text = f"run {Run.read(path).id[:12]}, measurement bad • the nut [acc1] is clipped"
    assert " ".join(outcome.out.split()).endswith(text)
