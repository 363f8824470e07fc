"""``ballscrew frf``: a run of noise, chirp or sine steps, as calibrate and preload take it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from benchmarks.drive_excitation import RATE, ROTOR_FREE, ROTOR_HELD, simulate

import ballscrew as package
from ballscrew import Run
from ballscrew.recording.channels import ChannelMap

MAP = """
sample_rate = "8 kHz"
[[channel]]
source = "force"
quantity = "force"
[[channel]]
source = "motor"
quantity = "speed"
[[channel]]
source = "x"
quantity = "position"
unit = "mm"
"""


def write(path: Path, seed: int = 0, **settings) -> Path:
    force, speed, added = simulate(seed, noise=1e-5, **settings)
    time = np.arange(force.size) / RATE
    names = "time [s],torque [N m],speed [m/s],noise [N m]"
    np.savetxt(path, np.stack([time, force, speed, added], 1), "%.9g", ",", header=names, comments="")
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("frf") / "noise.csv", seconds=0.5)


@pytest.fixture
def command(ballscrew, recording):
    def call(*more):
        return ballscrew("frf", recording, "--input", "torque [N m]", "--output", "speed [m/s]", *more)

    return call


def test_both_frequencies_are_printed_with_intervals_and_drawn(command, tmp_path):
    picture = tmp_path / "frf.png"
    outcome = command("--position", "200 mm", "--reference", "noise [N m]", "--plot", picture)
    assert (outcome.status, outcome.err) == (0, "")
    assert "antiresonance" in outcome.out
    assert "halves of the record" in outcome.out
    assert picture.stat().st_size > 10_000


def test_the_json_is_a_run_for_calibrate_and_preload(command, ballscrew, tmp_path):
    path, sheet, model = tmp_path / "run.json", tmp_path / "axis.toml", tmp_path / "model.json"
    outcome = command("--position", "200 mm", "--mass", "50 kg", "--json")
    path.write_text(outcome.out, encoding="utf-8")
    (cell,) = Run.read(path).cells
    assert (cell.position_m, cell.method, cell.verdict) == (0.2, "frf", "good")
    assert cell.frequency_Hz == pytest.approx(ROTOR_FREE, rel=2e-3)
    assert cell.rotor_held_frequency_Hz == pytest.approx(ROTOR_HELD, rel=3e-3)
    assert Run.from_json(json.loads(outcome.out)).to_json() == json.loads(outcome.out)
    sheet.write_text(SHEET, encoding="utf-8")
    assert ballscrew("calibrate", path, "--axis", sheet, "--out", model).status == 0
    assert ballscrew("preload", path, "--model", model).status == 0


def test_a_channel_map_gives_the_position_and_files_at_one_place_are_one_cell():
    recordings = []
    for seed in (1, 2):
        force, speed, _ = simulate(seed, noise=1e-5, seconds=0.4)
        place = np.full(force.size, 120.0)
        columns = {"force": force, "motor": speed, "x": place}
        channels = ChannelMap.from_settings(_settings(), "map")
        recordings.append(
            package.Recording.from_arrays(sample_rate=RATE, channels=channels, name=str(seed), **columns)
        )
    run = package.analyze_frf(recordings, "force", "motor", mass="0 kg", measured_at="2026-01-31T08:00Z")
    (cell,) = run.cells
    assert (cell.position_m, cell.repetitions, run.mass_kg) == (pytest.approx(0.12), 2, 0.0)
    assert run.measured_at == "2026-01-31T08:00:00+00:00"


def _settings():
    import tomllib

    return tomllib.loads(MAP)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "--position"),
        (("--position", "1 mm", "--position", "2 mm"), "2 positions given for 1 file;"),
        (("--position", "1 kg"), "kg"),
        (("--position", "200"), 'state the unit, such as "200 mm"'),
        (("--position", "1 mm", "--input", "iq"), "has no channel 'iq'; it has 'time [s]'"),
        (("--position", "1 mm", "--quantities", "torque", "torque"), "the output is a torque"),
        (("--position", "1 mm", "--output", "time [s]"), "--quantities torque speed"),
        (("--position", "1 mm", "--band", "300", "100"), "must rise"),
    ],
)
def test_a_wrong_option_is_one_sentence(command, options, message):
    outcome = command(*options)
    assert outcome.status == 2
    assert message in " ".join(outcome.err.split())
    assert "Traceback" not in outcome.err


def test_a_travelling_table_has_no_position():
    force, speed, _ = simulate(seconds=0.3)
    columns = {"force": force, "speed": speed, "position": np.linspace(0, 0.1, force.size)}
    trip = package.Recording.from_arrays(sample_rate=RATE, **columns)
    with pytest.raises(package.InputError, match="moves by 100 mm"):
        package.analyze_frf(trip, "force", "speed")


SHEET = """
name = "bench"
support = "fixed-free"
screw = { lead = "10 mm", root_diameter = "21.4 mm", length = "900 mm", bearing_to_zero = "120 mm", \
dynamic_load_rating = "17 kN", rigidity = "450 N/um", rigidity_preload_ratio = 0.1, preload_ratio = 0.04 }
bearing.stiffness = "180 N/um"
table.mass = "100 kg"
drive.rotor_inertia = "6.3e-4 kg m^2"
guide.friction = "25 N"
"""


def test_a_position_beyond_the_screw_of_the_data_sheet_is_refused(command, tmp_path):
    axis = tmp_path / "axis.toml"
    axis.write_text(SHEET)
    outcome = command("--position", "2 m", "--mass", "0 kg", "--axis", axis)
    assert outcome.status == 2
    assert "axis.toml: the position is 2 m; it must be on the screw" in " ".join(outcome.err.split())


def test_the_table_of_the_modes_is_exported(command, tmp_path):
    path = tmp_path / "modes.csv"
    assert command("--position", "200 mm", "--export", path).status == 0
    (row,) = pd.read_csv(path).to_dict("records")
    assert row["frequency_Hz"] == pytest.approx(ROTOR_FREE, rel=3e-3)
    wrong = command("--position", "200 mm", "--export", tmp_path / "modes.xlsx")
    assert (wrong.status, wrong.out) == (2, "")


def test_a_mode_that_is_not_found_has_dashes_and_a_reason(command):
    outcome = command("--position", "200 mm", "--band", "20", "60")
    assert outcome.status == 0
    assert "– │ – │ – │ –" in " ".join(outcome.out.split())


def recorded(seed, rate=RATE, **others):
    force, speed, _ = simulate(seed, noise=1e-5, seconds=0.3)
    return package.Recording.from_arrays(
        sample_rate=rate,
        name=f"{seed}.h5",
        force=force,
        speed=speed,
        position=np.full(force.size, 0.1),
        **others,
    )


def test_files_that_do_not_belong_together_are_refused():
    first = recorded(1)
    with pytest.raises(package.InputError, match="no file is given"):
        package.analyze_frf([], "force", "speed")
    with pytest.raises(package.InputError, match="a file is given twice"):
        package.analyze_frf([first, first], "force", "speed")
    with pytest.raises(package.InputError, match=r"2\.h5: the channels must have the same rate"):
        package.analyze_frf([first, recorded(2, rate=2 * RATE)], "force", "speed")


def test_a_set_point_determines_the_rotor_held_frequency_alone():
    _, speed, added = simulate(noise=1e-6)
    columns = {"position": np.full(speed.size, 0.1), "speed": speed, "torque": np.cumsum(added) / RATE}
    recording = package.Recording.from_arrays(sample_rate=RATE, name="a.h5", **columns)
    run = package.analyze_frf(recording, "torque", "speed", quantities=("speed", "speed"), band=(80, 350))
    (cell,) = run.cells
    assert (cell.frequency_Hz, cell.verdict) == (None, "refused")
    assert cell.rotor_held_frequency_Hz == pytest.approx(ROTOR_HELD, rel=5e-3)
    assert "set-point" in " ".join(cell.reasons)
