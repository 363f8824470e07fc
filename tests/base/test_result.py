"""What results offer at the prompt and in a notebook."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import signal
from tests.estimation.made_runs import MODEL, calibrated, run_of
from tests.monitoring.histories import history, worn

import ballscrew
from ballscrew.axis.axial import frequency
from ballscrew.base.errors import InputError
from ballscrew.base.quantity import Quantity
from ballscrew.base.result import (
    MOST_SENTENCES,
    PlottedResult,
    check_export,
    export_table,
    first_sentences,
    quantity_rows,
    with_interval,
)
from ballscrew.fcft.planned import plan
from ballscrew.recording.quality.finding import Quality
from ballscrew.testbed.example import AXIS, PLAN


def one_mode():
    w, force = 2 * np.pi * 100, np.random.default_rng(0).normal(size=(4, 2000))
    mode = signal.cont2discrete(([w**2], [1, 0.06 * w, w**2]), 1 / 4000, "foh")
    return force, signal.lfilter(np.ravel(mode[0]), mode[1], force), "4 kHz"


MAKE = {
    "quality": lambda: Quality("suspect", ("torque <b>clipped</b>",)),
    "run": lambda: run_of(0.8),
    "frf": lambda: ballscrew.frf(*one_mode()),
    "frequency": lambda: ballscrew.natural_frequency(*one_mode()),
    "plan": lambda: plan(PLAN, axis=AXIS),
    "capability": lambda: ballscrew.capability(PLAN, axis=AXIS),
    "optimised": lambda: ballscrew.optimise(replace(PLAN, masses=(0.0, 50.0)), AXIS),
    "model": calibrated,
    "preload": lambda: ballscrew.preload(run_of(0.8), calibrated(), run_of(name="base")),
    "without baseline": lambda: ballscrew.preload(run_of(0.8), calibrated()),
    "monitor": lambda: ballscrew.monitor(history(range(0, 60, 3), worn(9.0, 60.0)), calibrated()),
    "young": lambda: ballscrew.monitor(history([0.0]), calibrated()),
}
HEADS = {
    "quality": "<Quality> the measurement is suspect\n  torque <b>clipped</b>",
    "run": "<Run> bench with 100 kg: the measurement is good\n  40 cells: 40 good, 0 suspect, 0 refused\n",
    "frf": "<FrequencyResponse> FRF up to 2000 Hz in steps of 1 Hz, H1, 4 records averaged",
    "frequency": "<NaturalFrequency> 100.00",
    "plan": "<PlannedTest> example axis: 40 cells; with each load (50 kg) ",
    "capability": "<Capability> smallest detectable loss of preload ",
    "optimised": "<Optimised> 1.",
    "model": "<CalibratedAxis> bench: the calibration is good\n  1 run, 40 frequencies, 1 preload; χ² 40 ",
    "preload": "<PreloadEstimate> bench: stiffness good, preload of the nut suspect\n  axial stiffness as P",
    "without baseline": "<PreloadEstimate> bench: stiffness good, preload of the nut good\n  preload of the ",
    "monitor": "<Monitored> bench: alarm since 20",
    "young": "<Monitored> bench: learning; stiffness good, preload of the nut good\n",
}


@pytest.fixture(scope="module")
def results():
    return {name: make() for name, make in MAKE.items()}


@pytest.mark.parametrize("name", MAKE)
def test_a_representation_is_short_and_begins_with_the_conclusion(results, name):
    text = repr(results[name])
    assert text.startswith(HEADS[name])
    assert text.count("\n") <= 9


@pytest.mark.parametrize("name", MAKE)
def test_a_notebook_shows_text_and_table(results, name):
    text, table = results[name]._repr_html_(), results[name].to_dataframe()
    assert isinstance(table, pd.DataFrame)
    assert text.startswith("<p><strong>")
    assert text.endswith("</table>")
    assert text.count("<tr") <= 22
    assert "<b>" not in text


@pytest.mark.parametrize("name", MAKE)
def test_a_plot_is_on_the_axes_that_are_given(results, name):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    figure, axes = pyplot.subplots()
    assert results[name].plot(axes) is axes
    own = results[name].plot()
    assert axes.lines or axes.containers or axes.get_legend()
    assert (own.get_xlabel(), own.get_ylabel()) == (axes.get_xlabel(), axes.get_ylabel())
    for shown in (figure, own.figure):
        shown.canvas.draw()
        pyplot.close(shown)


def test_a_refused_estimate_has_no_plot_and_leaves_no_figure():
    pyplot = pytest.importorskip("matplotlib.pyplot")
    refused = ballscrew.preload(run_of(quality=Quality("bad", ("clipped",))), calibrated())
    with pytest.raises(InputError, match=r"nothing to draw: the measurement is bad: clipped"):
        refused.plot()
    assert repr(refused).startswith("<PreloadEstimate> bench: stiffness refused")
    good = ballscrew.preload(run_of(), calibrated())
    with pytest.raises(InputError, match="does not contain the cells"):
        ballscrew.PreloadEstimate.from_json(good.to_json()).plot()
    assert pyplot.get_fignums() == []


def test_columns_of_a_run_are_those_of_its_document():
    table = run_of(0.8).to_dataframe()
    assert list(table)[:6] == list(run_of().to_json()["cells"][0])[:6]
    assert table.frequency_Hz.iloc[0] == run_of(0.8).cells[0].frequency_Hz


def test_parameters_have_their_own_uncertainty_and_not_that_of_the_working_vector():
    table = calibrated().to_dataframe().set_index("quantity")
    model = calibrated()
    assert table.standard_uncertainty["preload"] == pytest.approx(
        MODEL.preload * model.standard_uncertainty("preload")
    )
    step = 1e-6
    share = 1 / (1 + np.exp(-(np.log(MODEL.share / (1 - MODEL.share)) + step)))
    scale = (share - MODEL.share) / step
    assert table.standard_uncertainty["share"] == pytest.approx(
        scale * model.standard_uncertainty("share"), rel=1e-4
    )
    held = replace(model, model=replace(MODEL, rotor=np.inf))
    assert "rotor" not in set(held.to_dataframe().quantity)


def test_the_levels_of_a_model_are_its_frequencies():
    pytest.importorskip("matplotlib")
    axes = calibrated().plot()
    x, f = axes.lines[0].get_data()
    np.testing.assert_allclose(f, frequency(MODEL, MODEL.centre, x))
    axes.figure.clear()


def test_quantities_are_rounded_alike():
    assert with_interval(Quantity(0.8, 0.034, "", (0.729, 0.8634))) == "0.800 ± 0.034 (95 %: 0.729 to 0.863)"
    assert with_interval(Quantity(3.0, 0.0, "N")) == "3 N (95 %: 3.000 to 3.000)"
    assert quantity_rows([("a", None)]).empty


def test_every_result_states_a_drawing_that_exists():
    from importlib import import_module

    for kind in PlottedResult.__subclasses__():
        module, _, name = kind._drawing.partition(":")
        assert callable(getattr(import_module(f"ballscrew.report.{module}"), name)), kind


@pytest.mark.parametrize("name", MAKE)
def test_every_table_is_exported_with_its_numbers(results, name, tmp_path):
    table = results[name].to_dataframe()
    for file, read in (("a.csv", pd.read_csv), ("a.parquet", pd.read_parquet)):
        pytest.importorskip("pyarrow")
        results[name].export(tmp_path / file)
        back = read(tmp_path / file)
        expected = [[f"{n}_real", f"{n}_imag"] if table[n].dtype.kind == "c" else [n] for n in table.columns]
        assert list(back.columns) == [name for names in expected for name in names]
        numbers = table.select_dtypes(["floating", "integer"])
        np.testing.assert_array_equal(back[numbers.columns].to_numpy(float), numbers.to_numpy(float))


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "  =1", "＝1"])
def test_no_text_of_a_csv_is_a_formula(text, tmp_path):
    table = pd.DataFrame({text: ["good", text], "x": [-1.5, 2.0]})
    export_table(table, tmp_path / "a.csv")
    back = pd.read_csv(tmp_path / "a.csv", skipinitialspace=False)
    guarded = "'" + text.replace("\t", "\t'").replace("\r", "\r'")  # a cell may begin after these, too
    assert list(back.columns) == [guarded, "x"]
    assert back.iloc[:, 0].tolist() == ["good", guarded]
    assert back["x"].tolist() == [-1.5, 2.0]
    pytest.importorskip("pyarrow")
    export_table(table, tmp_path / "a.parquet")
    assert pd.read_parquet(tmp_path / "a.parquet")[text].tolist() == ["good", text]


def test_the_folder_of_a_table_is_checked_before_the_work(tmp_path):
    with pytest.raises(InputError, match="cannot be written: make the folder"):
        check_export(tmp_path / "none" / "a.csv")
    with pytest.raises(InputError, match="it is a folder; name a file in it"):
        check_export(tmp_path)


def test_a_table_is_no_other_file(tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"ends with \.csv or \.parquet"):
        run_of(0.8).export(tmp_path / "a.xlsx")
    with pytest.raises(InputError, match="cannot be written"):
        run_of(0.8).export(tmp_path / "none" / "a.csv")
    monkeypatch.setattr("ballscrew.base.result.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r'pip install "ballscrew\[parquet\]"'):
        run_of(0.8).export(tmp_path / "a.parquet")
    assert not list(tmp_path.iterdir())


def test_limits_and_terms_of_a_cell_have_columns_of_their_own():
    run = run_of(0.8)
    cells = [replace(run.cells[0], band_Hz=(70.0, 370.0), uncertainty_terms_Hz={"noise": 0.1, "mount": 0.2})]
    cells += [replace(cell, band_Hz=None, uncertainty_terms_Hz={"noise": 0.3}) for cell in run.cells[1:2]]
    table = replace(run, cells=tuple(cells)).to_dataframe()
    assert not {"band_Hz", "uncertainty_terms_Hz"} & set(table)
    columns = ["band_low_Hz", "band_high_Hz", "uncertainty_noise_Hz", "uncertainty_mount_Hz"]
    np.testing.assert_array_equal(
        table[columns].to_numpy(float), [[70, 370, 0.1, 0.2], [np.nan] * 2 + [0.3, np.nan]]
    )


@pytest.mark.parametrize("names", [["x", "x"], ["H1", "H1_real"]])
def test_columns_of_one_name_are_refused(names, tmp_path):
    table = pd.concat([pd.Series([1 + 1j]), pd.Series([2.0])], axis=1, keys=names)
    with pytest.raises(InputError, match=f"two columns of the table have the name '{names[1]}'"):
        export_table(table if names[0] != "x" else table.map(np.real), tmp_path / "a.csv")
    assert not (tmp_path / "a.csv").exists()


@pytest.mark.parametrize("number", [0, 1, 3, 4, 10])
def test_of_many_sentences_the_first_are_shown_and_how_many_more_there_are(number: int) -> None:
    sentences = [f"{each}." for each in range(number)]
    shown = first_sentences(sentences)
    assert shown[:MOST_SENTENCES] == sentences[:MOST_SENTENCES]
    assert shown[MOST_SENTENCES:] == ([f"and {number - 3} more"] if number > 3 else [])
