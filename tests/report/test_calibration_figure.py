"""Figs. 9 and 10 with the calibrated model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.axis.conftest import Sheets
from tests.calibration.tables import table

from ballscrew.axis.axial import frequency, from_vector
from ballscrew.axis.axial_prior import prior
from ballscrew.base.errors import InputError
from ballscrew.calibration.calibrated_axis import CalibratedAxis, Doubt
from ballscrew.calibration.calibration import calibrate
from ballscrew.modal.run import Run

pytest.importorskip("matplotlib")

from ballscrew.report.calibration_figure import draw_calibration, points, predicted


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[CalibratedAxis, list[Run]]:
    sheet = Sheets(tmp_path_factory.mktemp("sheet")).read()
    model = from_vector(prior(sheet, 0.2)[0], 0.2)
    runs: list[Run] = [
        table(
            lambda x, m=load, p=part: float(frequency(model, x, m, p)),  # type: ignore[misc]
            (0.0, 0.2, 0.4), load, i, measured_at=f"2026-0{2 if part < 1 else 1}-01T00:00Z",
        )
        for i, (load, part) in enumerate(((0.0, 1.0), (50.0, 1.0), (100.0, 1.0), (100.0, 0.5)))
    ]  # fmt: skip
    return calibrate(runs, sheet), runs


def test_points_are_the_cells_beside_the_model(found: tuple[CalibratedAxis, list[Run]]) -> None:
    measured = points(*found)
    assert measured.load.shape == (4 * 12,)
    assert np.abs(measured.residual).max() < 0.01
    assert set(measured.group) == {0, 1}


def test_the_band_is_the_covariance_of_model_and_ratio(found: tuple[CalibratedAxis, list[Run]]) -> None:
    x = np.array([0.0, 0.4])
    f, u = predicted(found[0], x, np.array([100.0, 100.0]))
    worn, v = predicted(found[0], x, np.array([100.0, 100.0]), 1)
    assert np.all(worn < f)
    assert np.all((u > 0) & (u < 0.01 * f) & (v > 0) & (v < 0.01 * f))


def test_the_picture_has_both_panels_and_the_residuals(found: tuple[CalibratedAxis, list[Run]]) -> None:
    figure = draw_calibration(*found)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert any("along the axis" in title for title in titles)
    assert any("against load" in title for title in titles)
    assert any("root mean square" in title for title in titles)
    assert len(figure.axes[0].get_legend().get_texts()) == 4
    assert figure.get_suptitle().startswith("bench, 2026-01-01 to 2026-02-01: ")


def test_runs_of_another_model_are_refused(found: tuple[CalibratedAxis, list[Run]]) -> None:
    with pytest.raises(InputError, match="belongs to this model"):
        draw_calibration(found[0], [])


def test_the_title_counts_the_doubts(found: tuple[CalibratedAxis, list[Run]]) -> None:
    calibrated, runs = found
    doubtful = replace(calibrated, reasons=(Doubt("rank", "too few"), Doubt("misfit", "it scatters")))
    assert "suspect" not in draw_calibration(replace(calibrated, reasons=()), runs).get_suptitle()
    assert draw_calibration(doubtful, runs).get_suptitle().endswith("(suspect for 2 reasons)")


def test_points_lack_runs_of_other_axes_and_refused_cells(found: tuple[CalibratedAxis, list[Run]]) -> None:
    calibrated, runs = found
    cells = [replace(runs[0].cells[0], verdict="refused"), *runs[0].cells[1:]]
    other = replace(runs[1], id="f" * 64)
    measured = points(calibrated, [replace(runs[0], cells=tuple(cells)), other, *runs[2:]])
    assert measured.load.tolist() == [0.0] * 11 + [100.0] * 24
