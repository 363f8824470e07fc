from __future__ import annotations

import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest
from benchmarks.drive_signals import FORMATS, Record
from scipy.io import wavfile

from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.cli.init import init
from ballscrew.fcft.plan import read_plan
from ballscrew.recording.channels import read_channels
from ballscrew.recording.load import read_recording
from ballscrew.recording.quality.signals import check_signals

NAMES = ["axis.toml", "plan.toml", "channels.toml", "run.toml"]


def make(path: Path, **channels: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in channels.items():
            file[name] = values
    return path


def test_a_newcomers_csv(tmp_path: Path) -> None:
    recording = tmp_path / "in" / "trip 1.csv"
    recording.parent.mkdir()
    t = np.arange(3000) / 1000
    lines = [
        f"{a:.3f};{b:.4f};{c:.4f}".replace(".", ",")
        for a, b, c in zip(t, np.sin(t), 100 * np.cos(t), strict=True)
    ]
    recording.write_text("Zeit [s];Drehmoment (Nm);Weg / mm\n" + "\n".join(lines), encoding="utf-8")
    result = init([recording], tmp_path / "out")
    assert [path.name for path in result.written] == NAMES
    channels = read_channels(tmp_path / "out" / "channels.toml")
    assert [channel.name for channel in channels.channels] == [
        "torque",
        "position",
        "time",
        "acceleration:motor:x",
    ]
    read = read_recording(recording, channels)
    assert read.sample_rate == pytest.approx(1000)
    assert read.array("position")[0] == pytest.approx(0.1)
    run = tomllib.loads((tmp_path / "out" / "run.toml").read_text(encoding="utf-8"))
    assert run["files"] == ["../in/trip 1.csv"]
    assert (tmp_path / "out" / run["files"][0]).resolve() == recording.resolve()


def test_a_torque_in_percent_asks_for_the_rated_torque_and_names_the_next_command(
    ballscrew, tmp_path: Path
) -> None:
    recording = tmp_path / "trace.csv"
    recording.write_text("Istdrehmoment [%];Lage [mm]\n" + "1,5;2,5\n" * 100, encoding="utf-8")
    out = ballscrew("init", recording, "--out", tmp_path / "x-axis").out
    assert "drive.rated_torque too" in out
    assert f"Then: ballscrew analyze {tmp_path / 'x-axis' / 'run.toml'}\n" in out


def test_the_speed_of_a_motor_replaces_a_position_that_repeats(tmp_path: Path) -> None:
    """Its scale is the lead, which no file states; the position repeats for 4 ms."""
    recording = tmp_path / "trip.csv"
    t = np.arange(4000) / 2000
    place = 100 * np.sin(t) ** 3
    columns = np.stack([t, np.cos(300 * t), np.repeat(place[::8], 8), 6e3 * np.gradient(place, t)], axis=1)
    head = "time [s],torque [Nm],position [mm],n_ist [1/min]"
    np.savetxt(recording, columns, fmt="%.6f", delimiter=",", header=head, comments="")
    result = init([recording], tmp_path)
    assert "channels.toml: scale of 'n_ist [1/min]': the lead, in mm per revolution." in result.missing
    with pytest.raises(InputError, match="scale"):
        read_channels(tmp_path / "channels.toml")
    text = (tmp_path / "channels.toml").read_text(encoding="utf-8")
    (tmp_path / "channels.toml").write_text(text.replace('scale = "TODO"', "scale = 0.01"), encoding="utf-8")
    read = read_recording(recording, read_channels(tmp_path / "channels.toml"))
    assert (read.rate("position"), read.rate("acceleration:motor:x")) == (250, 2000)
    # 0.01 mm per revolution: the file has the speed in mm/s times 6000.
    np.testing.assert_allclose(read.array("speed"), 1e-3 * np.gradient(place, t), atol=1e-8)


def test_the_speed_of_a_motor_by_angle(tmp_path: Path) -> None:
    """62.83 rad/s and 10 mm of lead are 100 mm/s."""
    recording = tmp_path / "trip.csv"
    t = np.arange(4000) / 2000
    place = 100 * np.sin(t) ** 3
    columns = np.stack([t, np.cos(300 * t), np.repeat(place[::8], 8), np.gradient(place, t) / 10], axis=1)
    head = "time [s],torque [Nm],position [mm],n_ist [rad/s]"
    np.savetxt(recording, columns, fmt="%.6f", delimiter=",", header=head, comments="")
    result = init([recording], tmp_path)
    assert "channels.toml: scale of 'n_ist [rad/s]': the lead over 2π, in mm per radian." in result.missing
    text = (tmp_path / "channels.toml").read_text(encoding="utf-8")
    (tmp_path / "channels.toml").write_text(text.replace('scale = "TODO"', "scale = 10"), encoding="utf-8")
    read = read_recording(recording, read_channels(tmp_path / "channels.toml"))
    np.testing.assert_allclose(read.array("speed"), 1e-3 * np.gradient(place, t), atol=1e-5)


def test_currents_of_phases_are_written_with_their_phase(tmp_path: Path) -> None:
    recording = make(tmp_path / "a.h5", current_u=np.zeros(100), current_v=np.zeros(100), fs=np.zeros(1))
    init([recording], tmp_path)
    rows = tomllib.loads((tmp_path / "channels.toml").read_text(encoding="utf-8"))["channel"]
    assert [row["phase"] for row in rows if row["quantity"] == "current"] == ["u", "v"]


def test_what_is_not_filled_in_is_refused_by_name(tmp_path: Path) -> None:
    recording = make(tmp_path / "a.h5", foo=np.zeros(100), torque=np.zeros(100))
    result = init([recording], tmp_path)
    with pytest.raises(InputError, match="sample_rate is 'TODO'"):
        read_channels(tmp_path / "channels.toml")
    with pytest.raises(InputError, match=r"axis\.toml: name is 'TODO'"):
        read_axis(tmp_path / "axis.toml")
    with pytest.raises(InputError, match=r"plan\.toml: .* is .*TODO"):
        read_plan(tmp_path / "plan.toml")
    outcome = " ".join(result.missing)
    for part in (
        "the unit of 'torque'",
        "the position of the table",
        "sample_rate",
        "axis.toml",
        "load",
    ):
        assert part in outcome


def test_every_field_of_the_sheet_can_be_filled_in(tmp_path: Path) -> None:
    init([make(tmp_path / "a.h5", torque=np.zeros(100))], tmp_path)
    screw = ['"10 mm"', '"17.6 mm"', '"650 mm"', '"80 mm"', '"15 kN"', '"480 N/um"', "0.04"]
    rest = ['"160 N/um"', '"32 kg"', '"4.2e-4 kg m^2"']
    values = iter(['"x"', '"fixed-free"', *screw, *rest])
    text = (tmp_path / "axis.toml").read_text(encoding="utf-8")
    lines = [
        line.replace('"TODO"', next(values), 1) if ' = "TODO"' in line else line for line in text.splitlines()
    ]
    (tmp_path / "axis.toml").write_text("\n".join(lines), encoding="utf-8")
    assert next(values, None) is None
    assert read_axis(tmp_path / "axis.toml").screw.lead == 0.01


def test_nothing_is_overwritten_without_force(tmp_path: Path) -> None:
    recording = make(tmp_path / "a.h5", torque=np.zeros(100))
    (tmp_path / "plan.toml").write_text("mine")
    with pytest.raises(InputError, match=r"plan\.toml: exists already"):
        init([recording], tmp_path)
    assert (tmp_path / "plan.toml").read_text() == "mine"
    assert not (tmp_path / "axis.toml").exists()
    init([recording], tmp_path, force=True)
    assert (tmp_path / "plan.toml").read_text() != "mine"


def test_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file is given"):
        init([], tmp_path)
    with pytest.raises(InputError, match="has no channel"):
        init([make(tmp_path / "a.h5", picture=np.zeros((3, 4)))], tmp_path)  # type: ignore[arg-type]
    nameless = make(tmp_path / "c.h5", temp=np.zeros(100), **{f"channel{i}": np.zeros(100) for i in range(9)})
    with pytest.raises(
        InputError, match=r"c\.h5: no channel looks like a torque.*'channel0'.* and 5 more\. Name"
    ):
        init([nameless], tmp_path)
    good = make(tmp_path / "b.h5", torque=np.zeros(100))
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written to"):
        init([good], tmp_path / "file")
    assert not (tmp_path / "axis.toml").exists()


def test_files_that_differ_are_reported(tmp_path: Path) -> None:
    first = make(tmp_path / "a.h5", torque=np.zeros(100), pos=np.zeros(100))
    second = make(tmp_path / "b.h5", torque=np.zeros(100))
    result = init([first, second], tmp_path)
    assert "b.h5: lacks channels that a.h5 has: pos." in result.missing


def test_names_that_no_toml_can_hold(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for name in (b"a\xff", b'quote " back \\ tab \t', b"torque\x7f\n"):
            file[name] = np.zeros(100)
    init([path], tmp_path)
    text = (tmp_path / "channels.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["channel"][0]["source"] == "torque\x7f\n"
    unused = text[text.index("# In the files, and not used") :].splitlines()[1:]
    assert (
        tomllib.loads("\n".join(line.removeprefix("#").strip() for line in unused))["channel"][0]["source"]
        == 'quote " back \\ tab \t'
    )


@pytest.mark.slow
def test_a_file_of_very_many_channels(tmp_path: Path) -> None:
    make(tmp_path / "a.h5", torque=np.zeros(20), **{f"channel{i}": np.zeros(20) for i in range(3000)})
    init([tmp_path / "a.h5"], tmp_path)
    assert (tmp_path / "channels.toml").stat().st_size < 50_000


def test_the_plan_of_the_bench_is_measured(bench: Path, tmp_path: Path) -> None:
    init(sorted(bench.glob("preload-4-percent-trip*.h5")), tmp_path)
    text = (tmp_path / "plan.toml").read_text(encoding="utf-8")
    assert "# measured from the file" in text
    filled = text.replace('["TODO"]', '["100 kg"]')
    (tmp_path / "plan.toml").write_text(filled, encoding="utf-8")
    guessed, true = read_plan(tmp_path / "plan.toml"), read_plan(bench / "plan.toml")
    assert guessed.positions == pytest.approx(true.positions, abs=1e-4)
    assert guessed.repetitions == true.repetitions
    assert guessed.motions[0].speed == pytest.approx(true.motions[0].speed, rel=0.03)
    assert guessed.motions[0].acceleration == pytest.approx(true.motions[0].acceleration, rel=0.1)
    assert guessed.motions[0].dwell == pytest.approx(true.motions[0].dwell, abs=0.02)
    used = [channel.source for channel in read_channels(tmp_path / "channels.toml").channels]
    assert used == ["torque", "position", "acc1_x", "acc2_x"]


def test_a_wav_file_gets_a_channel_map_to_fill_in(tmp_path: Path) -> None:
    path = tmp_path / "a.wav"
    wavfile.write(path, 12800, np.zeros((100, 2), np.int16))
    result = init([path], tmp_path)
    assert "channels.toml: sensor (quantity), unit and scale of 'channel 2'." in result.missing
    assert not [sentence for sentence in result.missing if "looks like" in sentence]
    text = (tmp_path / "channels.toml").read_text(encoding="utf-8")
    assert 'sample_rate = "12800 Hz"' in text
    with pytest.raises(InputError, match=r"channel\[0\]\.quantity is 'TODO'"):
        read_channels(tmp_path / "channels.toml")
    for name, value in (("quantity", '"torque"'), ("unit", '"N m"'), ("scale", "0.01")):
        text = text.replace(f'{name} = "TODO"', f"{name} = {value}")
    (tmp_path / "channels.toml").write_text(text, encoding="utf-8")
    channels = read_channels(tmp_path / "channels.toml").channels
    assert [(channel.source, channel.scale) for channel in channels] == [
        ("channel 1", 0.01),
        ("channel 2", 0.01),
    ]


def test_channels_with_rates_of_their_own_need_no_sample_rate(tmp_path: Path) -> None:
    head = [
        "Name\ta",
        "File\tb",
        "",
        "Name\tTorqueCurrent\tName\tActPos",
        "SampleTime[ms]\t0,5\tSampleTime[ms]\t1",
        "Unit\tA (Current)\tUnit\tmm (Length)",
        "",
    ]
    rows = [f"{0.5 * index:g}\t{index % 7}\t{index}\t{0.1 * index:g}" for index in range(400)]
    path = tmp_path / "scope.csv"
    path.write_text("\n".join([*head, *rows]) + "\n")
    result = init([path], tmp_path)
    assert not [sentence for sentence in result.missing if "sample_rate" in sentence]
    assert '# sample_rate = "2000 Hz"' in (tmp_path / "channels.toml").read_text()


def test_the_times_of_a_tncscope_file_contradict_no_rate(tmp_path: Path) -> None:
    """They are in microseconds, which its columns do not state."""
    t = np.arange(2000) / 4000
    record = Record(np.round(np.cos(50 * t), 3), np.round(0.1 * np.sin(t), 8), 4000.0, 4000.0)
    FORMATS["HEIDENHAIN"].write(tmp_path / "trip.sco", record)
    init([tmp_path / "trip.sco"], tmp_path)
    found = check_signals(read_recording(tmp_path / "trip.sco", read_channels(tmp_path / "channels.toml")))
    assert "rate" not in [finding.code for finding in found]


def test_a_frequency_response_is_for_another_command(data: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="analyse it by ballscrew frf"):
        init([data / "machine-files" / "sinumerik-freq-trace.xml"], tmp_path)


def test_a_second_position_is_not_used_and_a_missing_torque_is_named(ballscrew, tmp_path: Path) -> None:
    t = np.arange(2000) / 1000
    columns = np.stack([t, 100 * np.sin(t), 100 * np.sin(t) + 1], axis=1)
    recording = tmp_path / "trip.csv"
    head = "time [s],position [mm],position reference [mm]"
    np.savetxt(recording, columns, fmt="%.6f", delimiter=",", header=head, comments="")
    outcome = ballscrew("init", recording, "--out", tmp_path)
    words = " ".join(outcome.out.split())
    assert words.count("not used") == 1
    assert words.index("position reference") < words.index("not used")
    assert "• channels.toml: no channel looks like a torque, a force or a current; name the one" in words
    assert "name the position" not in words
    torque = tmp_path / "torque.csv"
    np.savetxt(torque, columns[:, :2], fmt="%.6f", delimiter=",", header="time [s],torque [Nm]", comments="")
    words = " ".join(ballscrew("init", torque, "--out", tmp_path, "--force").out.split())
    assert "no channel looks like a torque" not in words
    assert "not used" not in words


def test_a_recording_on_another_drive_has_its_whole_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def relpath(*_: object) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr("ballscrew.cli.init.os.path.relpath", relpath)
    recording = make(tmp_path / "in.h5", torque=np.zeros(100))
    init([recording], tmp_path / "out")
    run = tomllib.loads((tmp_path / "out" / "run.toml").read_text(encoding="utf-8"))
    assert run["files"] == [recording.resolve().as_posix()]
