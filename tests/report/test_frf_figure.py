from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tests.report.axis_m import (
    assert_every_axis_has_its_unit,
    assert_nothing_leaves_the_picture,
    assert_the_same_file_twice,
    texts,
)
from tests.report.some_runs import LINES, cell_names, points, run_of_modes

from ballscrew.base.errors import InputError
from ballscrew.base.provenance import Made
from ballscrew.report.canvas import CONDITION_COLOURS
from ballscrew.report.frf_figure import draw_frf

RUN = run_of_modes()


def curve(figure):
    (line,) = [
        x
        for x in figure.axes[0].get_lines()
        if x.get_color() == CONDITION_COLOURS["PA"] and len(x.get_xdata()) > 2
    ]
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


def test_units_margins_and_the_same_file(tmp_path):
    figure = draw_frf(RUN, 0.1, "PA", truth=170.0)
    assert_every_axis_has_its_unit(figure)
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(lambda: draw_frf(RUN, 0.1, "PA", truth=170.0), tmp_path)


def test_the_curve_is_the_root_mean_square_of_the_responses():
    f, height = curve(draw_frf(RUN, 0.1, "PA"))
    mode = np.abs(3 / (1 - (f / 170) ** 2 + 0.06j * f / 170))
    assert set(f) <= set(LINES)
    assert height == pytest.approx(mode * np.sqrt((1 + 1.1**2) / 2))


def test_the_star_stands_on_the_curve_at_the_natural_frequency():
    figure = draw_frf(RUN, 0.1, "PA")
    ((f, height),) = points(figure.axes[0], "*")
    assert f == 171.0
    assert height == pytest.approx(np.interp(171.0, *curve(figure)))
    assert "171.0 ± 1.0 Hz (95 %)" in texts(figure)


def test_interval_band_and_truth_stand_where_they_were_given():
    figure = draw_frf(RUN, 0.1, "PA", truth=170.0)
    for axes in figure.axes:
        spans = sorted((p.get_x(), p.get_x() + p.get_width()) for p in axes.patches)
        assert spans[0] == pytest.approx((136, 204))
        assert spans[1] == pytest.approx((171 - 0.98, 171 + 0.98))
        assert [list(x.get_xdata()) for x in axes.get_lines() if x.get_color() == "black"][:1] == [
            [170.0, 170.0]
        ]
    assert "true: 170.0 Hz" in texts(figure)


def test_no_truth_no_line():
    assert "true" not in texts(draw_frf(RUN, 0.1, "PA"))


def test_a_phase_that_wraps_is_interrupted():
    table = RUN.frequency_response
    late = table.assign(H1=table["H1"] * np.exp(-0.1j * table["frequency"]))
    phase = draw_frf(replace(RUN, frequency_response=late), 0.1, "PA").axes[1]
    lines = [np.asarray(line.get_ydata(), float) for line in phase.get_lines() if len(line.get_xdata()) > 2]
    assert len(lines) == 2
    for line in lines:
        assert np.isnan(line).any()
        assert np.nanmax(np.abs(np.diff(line))) <= 180


def test_a_refused_cell_has_its_reason_and_no_star():
    figure = draw_frf(run_of_modes(refused={(0.1, "PA")}), 0.1, "PA", truth=170.0)
    assert points(figure.axes[0], "*") == []
    assert "refused: the FRF has no peak" in texts(figure)
    assert_nothing_leaves_the_picture(figure)


def test_a_suspect_cell_has_its_reason():
    cells = tuple(replace(c, verdict="suspect", reasons=("it costs $1 and $2",)) for c in RUN.cells)
    assert "suspect: it costs" in texts(draw_frf(replace(RUN, cells=cells), 0.1, "PA"))


@pytest.mark.parametrize(
    ("run", "where", "message"),
    [
        (run_of_modes(spectra=False), (0.1, "PA"), "contains no frequency response"),
        (run_of_modes(spectra=False, refused=cell_names()), (0.1, "PA"), "the FRF has no peak"),
        (RUN, (0.3, "PA"), "no cell at 300 mm, PA, motion 0; it has stops at 0, 100, 200 mm"),
        (RUN, (0.0, "NA"), "no cell at 0 mm, NA"),
        (run_of_modes(missing={(0.1, "PA")}, refused={(0.1, "PA")}), (0.1, "PA"), "the FRF has no peak"),
    ],
    ids=["from JSON", "a bad run", "no such stop", "no such condition", "no spectra"],
)
def test_impossible_pictures_are_refused(run, where, message):
    with pytest.raises(InputError, match=message):
        draw_frf(run, *where)


def test_an_unknown_estimator_is_refused():
    with pytest.raises(InputError, match="estimator is 'H9'"):
        draw_frf(replace(RUN, made=Made({"estimator": "H9"})), 0.1, "PA")
