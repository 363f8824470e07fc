from __future__ import annotations

from ballscrew.base.jsonfile import SCHEMA


def test_written_files_are_listed(ballscrew, rig, tmp_path):
    outcome = ballscrew("init", rig / "trip1.h5", rig / "trip2.h5", "--out", tmp_path / "new")
    assert (outcome.status, outcome.err) == (0, "")
    for name in ("axis.toml", "plan.toml", "channels.toml", "run.toml"):
        assert (tmp_path / "new" / name).is_file()
        assert name in outcome.out
    assert "To complete:" in outcome.out
    assert f"ballscrew analyze {tmp_path / 'new' / 'run.toml'}" in outcome.out
    for channel in ("torque", "position", "acc1_x"):
        assert channel in outcome.out


def test_json(ballscrew, rig, tmp_path):
    outcome = ballscrew("init", rig / "trip1.h5", "--out", tmp_path, "--json")
    assert outcome.status == 0
    document = outcome.document
    assert document["schema"] == SCHEMA
    assert len(document["written"]) == 4
    assert {g["channel"]: g["quantity"] for g in document["guesses"]}["torque"] == "torque"
    assert document["missing"]


def test_nothing_is_overwritten_without_force(ballscrew, rig, tmp_path):
    assert ballscrew("init", rig / "trip1.h5", "--out", tmp_path).status == 0
    again = ballscrew("init", rig / "trip1.h5", "--out", tmp_path)
    assert again.status == 2
    assert "exists already" in again.err
    assert again.err.count("\n") == 1
    assert ballscrew("init", rig / "trip1.h5", "--out", tmp_path, "--force").status == 0


def test_a_file_that_cannot_be_read(ballscrew, tmp_path):
    (tmp_path / "poem.h5").write_text("not a recording")
    outcome = ballscrew("init", tmp_path / "poem.h5", "--out", tmp_path / "new")
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1
    assert not (tmp_path / "new" / "axis.toml").exists()
