from __future__ import annotations

import re
from dataclasses import replace

import h5py
import numpy as np
import pandas as pd
import pytest
from tests.cli.conftest import FILES, RATE
from tests.estimation.made_runs import run_of
from tests.recording.synthetic import synthetic_trip, write_trip
from threadpoolctl import threadpool_limits

import ballscrew as package
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.native import read_table
from ballscrew.base.tables import FREQUENCY_RESPONSE, validate
from ballscrew.cli.analyze import print_run
from ballscrew.modal.cell import CellResult
from ballscrew.modal.joint.identify import identify_jointly
from ballscrew.modal.reason import Reason
from ballscrew.modal.run import FrameMode, RigidBodyResult, Run
from ballscrew.recording.drive_input import DriveInput
from ballscrew.recording.measure import measure
from ballscrew.recording.rotation import TableRotation
from ballscrew.recording.temperature import TemperatureCourse
from ballscrew.report.explain_words import frame_words

pytestmark = pytest.mark.usefixtures("fitted_once")


def flags(rig):
    return [part for name in ("axis", "plan", "channels") for part in (f"--{name}", rig / f"{name}.toml")]


def test_the_json_is_the_run(ballscrew, rig, result):
    outcome = ballscrew("analyze", rig / "run.toml", "--json")
    assert (outcome.status, outcome.err) == (0, "")
    document = outcome.document
    assert document == result.to_json()
    assert Run.from_json(document).to_json() == document
    assert document["schema"] == SCHEMA
    assert document["run"]["axis"] == "synthetic"
    assert document["run"]["measured_at"].startswith("2026-01-31T08:00")
    assert document["run"]["temperature_C"] == pytest.approx(21)
    assert document["quality"] == {"verdict": "good", "reasons": [], "notes": []}
    assert len(document["cells"]) == 20
    assert {c["repetitions"] for c in document["cells"]} == {2}
    assert document["made"]["settings"]["method"] == "joint"
    assert {c["method"] for c in document["cells"]} == {"joint"}


@pytest.mark.parametrize("method", ["joint", pytest.param("paper", marks=pytest.mark.slow)])
def test_the_document_does_not_depend_on_the_order_of_files_or_the_number_of_threads(
    rig, method, monkeypatch
):
    monkeypatch.setattr("ballscrew.modal.joint.analysis.identify_jointly", identify_jointly)
    files = [rig / "trip1.h5", rig / "trip2.h5"]
    setup = {name: rig / f"{name}.toml" for name in ("axis", "plan", "channels")}
    with threadpool_limits(1, user_api="blas"):
        first = package.analyze(files, mass=100.0, method=method, **setup)
    with threadpool_limits(2, user_api="blas"):
        other = package.analyze(files[::-1], mass=100.0, method=method, **setup)
    assert other.to_json() == first.to_json()
    assert other.frequency_response.identical(first.frequency_response)


def test_progress_is_reported(rig):
    steps = []
    package.analyze(rig / "run.toml", progress=lambda *step: steps.append(step))
    assert steps == [
        (0, 2, "trip1.h5"), (1, 2, "trip2.h5"), (2, 2, ""), (2, 2, "fitting all cells as one"),
    ]  # fmt: skip


def test_help_names_the_choices_of_an_option(ballscrew):
    shown = ballscrew("analyze", "--help").out
    for choice in ("joint|paper", "nut|motor|both", "H1|H2|Hv", "spectra|ratios"):
        assert choice in shown


def test_masses_of_the_run(result):
    body = result.rigid_body
    assert body.moving_mass_kg == pytest.approx(132.0, rel=0.03)
    assert body.frf_equivalent_mass_kg == pytest.approx(body.equivalent_mass_kg, rel=0.03)
    assert set(body.standard_uncertainty) >= {
        "equivalent_mass_kg",
        "moving_mass_kg",
        "frf_equivalent_mass_kg",
    }
    assert body.reasons == ()


def test_run_toml_and_flags_give_the_same(ballscrew, rig, result):
    by_hand = ballscrew(
        "analyze", rig / "trip1.h5", rig / "trip2.h5", *flags(rig), "--mass", "100 kg",
        "--measured-at", "2026-01-31T08:00:00Z", "--temperature", "21 degC", "--json",
    ).document  # fmt: skip
    assert by_hand == result.to_json()


def test_flags_override_run_toml(ballscrew, rig, result):
    document = ballscrew(
        "analyze", rig / "run.toml", "--mass", "101 kg", "--json", "--method", "paper"
    ).document
    assert document["run"]["mass_kg"] == 101.0
    assert document["id"] != result.id


def test_the_table(ballscrew, rig, result):
    outcome = ballscrew("analyze", rig / "run.toml")
    assert (outcome.status, outcome.err) == (0, "")
    first, second, *_ = outcome.out.splitlines()
    assert re.fullmatch(r"synthetic: axial natural frequency \d+\.\d to \d+\.\d Hz at \d+ stops", first)
    assert second == "Measurement: good; load 100 kg, 21.0 °C, 2 files"
    assert "Equivalent mass" not in outcome.out
    assert "20 cells: " in outcome.out
    stops = {f"{round(1e3 * cell.position_m, 1):.1f}" for cell in result.cells}
    rows = re.findall(r"^│ +(-?\d+\.\d) │ +([\d.]+) │", outcome.out, re.MULTILINE)
    assert {stop for stop, _ in rows} == stops
    assert len(rows) == len(stops)
    outcome = ballscrew("analyze", rig / "run.toml", "--verbose")
    assert outcome.out.startswith(first)
    assert f"Run {result.id[:12]}" in outcome.out
    assert "Equivalent mass" in outcome.out
    found = next(c for c in result.cells if c.frequency_Hz is not None)
    assert f"{found.frequency_Hz:.2f}" in outcome.out
    held = f"{found.rotor_held_frequency_Hz:.2f} ± {found.rotor_held_standard_uncertainty_Hz:.2f}"
    assert held in outcome.out
    assert "-0.0 " not in outcome.out
    assert max(map(len, outcome.out.splitlines())) <= 110


def test_the_papers_method(ballscrew, rig):
    by_paper = ballscrew("analyze", rig / "run.toml", "--method", "paper")
    assert by_paper.status == 0
    assert "rotor held" not in by_paper.out
    document = ballscrew("analyze", rig / "run.toml", "--method", "paper", "--json").document
    assert {c["method"] for c in document["cells"]} == {"paper"}
    assert {c["rotor_held_frequency_Hz"] for c in document["cells"]} == {None}


def test_the_response_is_used_and_recorded(ballscrew, rig):
    by_motor, by_nut = (
        ballscrew("analyze", rig / "run.toml", "--response", name, "--json").document
        for name in ("motor", "nut")
    )
    assert by_motor["made"]["settings"]["response"] == "motor"
    assert by_nut["made"]["settings"]["response"] == "nut"
    frequencies = ([c["frequency_Hz"] for c in each["cells"]] for each in (by_motor, by_nut))
    assert next(frequencies) != next(frequencies)


def test_without_sheet_and_plan(ballscrew, rig):
    outcome = ballscrew("analyze", rig / "trip1.h5", "--channels", rig / "channels.toml", "--json")
    assert outcome.status == 0, "good quality, all cells refused: done"
    assert outcome.document["rigid_body"]["equivalent_mass_kg"] is None
    assert outcome.document["rigid_body"]["reasons"]
    assert outcome.document["run"]["mass_kg"] is None
    by_paper = ballscrew(
        "analyze", rig / "trip1.h5", "--channels", rig / "channels.toml", "--method", "paper", "--json"
    )
    assert {c["verdict"] for c in by_paper.document["cells"]} == {"refused"}
    text = ballscrew("analyze", rig / "trip1.h5", "--channels", rig / "channels.toml", "--method", "paper")
    assert text.status == 0
    assert "neither a data sheet (--axis) nor --band" in " ".join(text.out.split())


def test_a_bad_measurement_has_status_1_and_is_printed(ballscrew, rig):
    outcome = ballscrew("analyze", rig / "bad.h5", *flags(rig), "--json")
    assert outcome.status == 1
    assert outcome.document["quality"]["verdict"] == "bad"
    assert all(reason in outcome.err for reason in outcome.document["quality"]["reasons"])
    assert {c["frequency_Hz"] for c in outcome.document["cells"]} == {None}
    assert len(outcome.document["cells"]) == 20
    table = ballscrew("analyze", rig / "bad.h5", *flags(rig))
    assert table.status == 1
    assert "bad" in table.out


@pytest.mark.parametrize(
    ("extra", "expected"),
    [
        (["--band", "200", "100"], "the upper end of the band is 100.0; it must be a number, more than 200"),
        (["--band", "0", "100"], "the lower end of the band is 0.0; it must be a number, more than 0"),
        (["--estimator", "H9"], "the estimator is 'H9'; it must be one of H1, H2, Hv"),
        (["--average", "mean"], "the average is 'mean'; it must be one of spectra, ratios"),
        (["--method", "magic"], "the method is 'magic'; it must be one of joint, paper"),
        (["--response", "ear"], "the response is 'ear'; it must be one of nut, motor, both"),
        (["--explain", "45mm"], "it must be position, condition"),
        (["--explain", "45:PD"], "the position needs its unit"),
        (["--explain", "45kg:PD"], "--explain is '45kg:PD'"),
        (["--explain", "30mm:XY"], "the condition must be one of PD, PA, NA, ND"),
        (["--explain", "30mm:PD:one"], "the motion must be a whole number"),
        (["--explain", "30mm:PD:-1"], "the motion must be a whole number"),
        (
            ["--method", "paper", "--explain", "47mm:PD"],
            "no cell 47mm:PD:0; it has stops at 0, 30, 60, 90, 120, 150 mm",
        ),
        (["--method", "paper", "--explain", "0mm:PD"], "no cell 0mm:PD:0; at 0 mm it has PA, ND"),
        (["--method", "paper", "--explain", "30mm:PD:1"], "no cell 30mm:PD:1; at 30 mm it has"),
        (["--explain", "30mm:PD", "--plot", "why.jpg"], "a picture's name must end in .png, .svg, .pdf"),
        (["--mass", "7 mm"], "the load (mass) is '7 mm'"),
        (["--measured-at", "noon"], "measured_at is 'noon'"),
        (["--temperature", "hot"], "the temperature is 'hot'"),
        (["--plot", "run.jpg"], "a picture's name must end in .png, .svg, .pdf"),
        (["--plot", "no/such/folder/run.png"], "does not exist"),
        (["--spectra", "no/such/folder/spectra.h5"], "spectra.h5"),
        (["--spectra", "."], "cannot be written"),
    ],
)
def test_a_wrong_option_gives_one_sentence_and_status_2(ballscrew, rig, extra, expected):
    outcome = ballscrew("analyze", rig / "run.toml", *extra)
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.startswith("ballscrew: ")
    assert outcome.err.count("\n") == 1
    assert expected in outcome.err


def test_settings_are_used_and_recorded(ballscrew, rig):
    outcome = ballscrew(
        "analyze", rig / "run.toml", "--json",
        "--estimator", "Hv", "--average", "ratios", "--band", "100", "220",
    ).document  # fmt: skip
    settings = outcome["made"]["settings"]
    assert (settings["estimator"], settings["average"], settings["band"]) == ("Hv", "ratios", [100.0, 220.0])
    by_paper = ballscrew(
        "analyze", rig / "run.toml", "--json", "--method", "paper", "--band", "100", "220"
    ).document
    assert by_paper["cells"][0]["band_Hz"] == [100.0, 220.0]


def test_the_band_stands_in_place_of_the_sheet(ballscrew, rig):
    outcome = ballscrew("analyze", rig / "run.toml", "--json", "--band", "250", "400").document
    joint = outcome["made"]["settings"]["joint"]
    assert (joint["lowest"], joint["highest"]) == (250.0, 400.0)


def test_spectra_are_written(ballscrew, rig, tmp_path):
    path = tmp_path / "spectra.h5"
    assert ballscrew("analyze", rig / "run.toml", "--method", "paper", "--spectra", path).status == 0
    table = validate(read_table(path), FREQUENCY_RESPONSE)
    assert table.sizes["cell"] == 20
    bad = ballscrew("analyze", rig / "bad.h5", *flags(rig), "--spectra", tmp_path / "none.h5")
    assert bad.status == 1
    assert "none.h5: was not written, since no cell has spectra" in bad.err
    assert bad.out, "the result is printed all the same"
    assert not (tmp_path / "none.h5").exists()


@pytest.mark.parametrize(
    ("ending", "method"),
    [("png", "joint"), ("svg", "paper"), pytest.param("pdf", "paper", marks=pytest.mark.slow)],
)
def test_a_picture_is_written(ballscrew, rig, tmp_path, ending, method):
    path = tmp_path / f"run.{ending}"
    assert ballscrew("analyze", rig / "run.toml", "--method", method, "--plot", path).status == 0
    assert path.stat().st_size > 5000


def test_a_folder_for_a_file(ballscrew, rig, tmp_path):
    for files in ([tmp_path], [rig / "trip1.h5", tmp_path]):
        outcome = ballscrew("analyze", *files, "--channels", rig / "channels.toml")
        assert outcome.status == 2
        assert outcome.err.count("\n") == 1


def test_names_that_look_like_markup(ballscrew, rig, tmp_path):
    """An axis named [red] is shown as it is named, not taken for a colour."""
    for name in ("axis.toml", "plan.toml", "channels.toml"):
        text = FILES[name].replace('name = "synthetic"', 'name = "[red]x[/nonsense]"')
        (tmp_path / name).write_text(text)
    outcome = ballscrew("analyze", rig / "trip1.h5", rig / "trip2.h5", *flags(tmp_path), "--method", "paper")
    assert outcome.status == 0
    assert "[red]x[/nonsense]" in outcome.out


def test_the_function_of_the_same_name(rig):
    run = package.analyze(
        [rig / "trip1.h5", str(rig / "trip2.h5")],
        channels=rig / "channels.toml",
        axis=str(rig / "axis.toml"),
        plan=rig / "plan.toml",
        mass=100,
    )
    assert run.quality.verdict == "good"
    assert run.frequency_response.sizes["cell"] == 20
    assert np.isfinite(run.frequency_response["S_uu"].values).all()


def printed(capsys, run, *, verbose=True):
    """What ``analyze`` prints of a run, on one line."""
    capsys.readouterr()
    print_run(run, verbose=verbose)
    return " ".join(capsys.readouterr().out.split())


def test_the_table_of_the_cells_is_exported(ballscrew, rig, tmp_path):
    path = tmp_path / "cells.csv"
    assert ballscrew("analyze", rig / "run.toml", "--method", "paper", "--export", path).status == 0
    table = pd.read_csv(path)
    assert len(table) == 20
    wrong = ballscrew("analyze", rig / "run.toml", "--export", tmp_path / "cells.xlsx")
    assert (wrong.status, wrong.out) == (2, "")
    assert "ends with .csv or .parquet" in wrong.err


def test_details_name_the_drive_signals_the_frame_and_the_rotation_of_the_table(capsys):
    run = run_of(temperature_C=21.0)
    plain = printed(capsys, run)
    for words in ("Driven by", "frame has a mode", "Table:", "±  K"):
        assert words not in plain
    assert "21.0 °C, 1 file" in plain
    found = replace(
        run,
        temperature=TemperatureCourse(21.0, 20.0, 22.0, 3.0),
        drive_input=DriveInput("current", ("i_u", "i_v"), "data sheet"),
        frame_mode=FrameMode(41.0, 0.5, 0.02, 12.3, 0.1, True),
        table_rotation=(
            TableRotation("pitch", ratio_at_mode=0.123, frequency_Hz=87.4),
            TableRotation("yaw", frequency_Hz=65.0),
            TableRotation("roll"),
        ),
    )
    words = printed(capsys, found)
    assert "21.0 °C ± 0.9 K, 1 file" in words  # a uniform distribution
    assert "Driven by i_u, i_v, pole pairs by the data sheet" in words
    assert frame_words(found.frame_mode) in words
    assert "Table: pitch 0.12 of the motion along the screw at the mode, most at 87 Hz" in words
    assert "Table: yaw, most at 65 Hz" in words
    assert "roll" not in words
    torque = replace(run, drive_input=DriveInput("torque", ("m",)))
    assert "Driven by" not in printed(capsys, torque)


def test_details_have_the_masses_that_are_known_and_why_the_others_are_not(capsys):
    body = RigidBodyResult(equivalent_mass_kg=170.0, reasons=("the lead is not known",))
    words = printed(capsys, replace(run_of(), rigid_body=body))
    assert "Equivalent mass 170 kg • the lead is not known" in words
    for name in ("Moving mass", "friction", "Offset", "from the FRF"):
        assert name not in words


def test_the_hint_names_the_motion_where_there_are_several(capsys):
    first, *others = run_of().cells
    reason = Reason("noise", "there is noise")
    refused = CellResult.refused(first.key._replace(motion=1), 10, "joint", [reason])
    words = printed(capsys, replace(run_of(), cells=(*others, refused)), verbose=False)
    assert words.endswith(f"--explain {round(1e3 * first.position_m, 1):g}mm:{first.condition}:1")
    refused = CellResult.refused(first.key, 10, "joint", [reason])
    words = printed(capsys, replace(run_of(), cells=(*others, refused)), verbose=False)
    assert words.endswith(f"--explain {round(1e3 * first.position_m, 1):g}mm:{first.condition}")


def test_a_temperature_that_was_recorded_is_that_of_the_run_unless_it_is_stated(rig, tmp_path):
    signals = synthetic_trip(rate=RATE, seed=1)
    path = write_trip(tmp_path / "warm.h5", signals, RATE)
    with h5py.File(path, "a") as file:
        file["nut_temperature"] = np.linspace(23.0, 24.0, len(signals["position"]))
    channels = (rig / "channels.toml").read_text(encoding="utf-8")
    row = (
        '[[channel]]\nsource = "nut_temperature"\nquantity = "temperature"\nunit = "degC"\nlocation = "nut"\n'
    )
    (tmp_path / "channels.toml").write_text(channels + row, encoding="utf-8")
    setup = {"channels": tmp_path / "channels.toml", "method": "paper"}
    measured = package.analyze(path, **setup)
    assert measured.temperature is not None
    assert measured.temperature_C == measured.temperature.mean_C == pytest.approx(23.5, abs=0.05)
    stated = package.analyze(path, temperature="21 degC", **setup)
    assert stated.temperature_C == pytest.approx(21.0)
    assert stated.temperature == measured.temperature


def test_all_cells_are_suspect_where_the_motion_of_the_motor_is_delayed(rig, result, monkeypatch):
    def delayed(*arguments, **options):
        return replace(measure(*arguments, **options), motor_delayed=True)

    monkeypatch.setattr("ballscrew.modal.analyze.measure", delayed)
    run = package.analyze(rig / "run.toml")
    assert {cell.verdict for cell in run.cells} == {"suspect"}
    for cells, delay in ((result.cells, False), (run.cells, True)):
        assert {"the motor's motion is delayed" in " ".join(cell.reasons) for cell in cells} == {delay}
