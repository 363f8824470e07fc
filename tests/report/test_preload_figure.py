from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from tests.estimation.made_runs import calibrated, run_of
from tests.report.axis_m import assert_nothing_leaves_the_picture, assert_the_same_file_twice, texts

from ballscrew.base.errors import InputError
from ballscrew.estimation.preload import preload
from ballscrew.recording.quality.finding import Quality
from ballscrew.report.preload_figure import draw_preload
from ballscrew.report.preload_map_figure import draw_preload_map


def day(number: int, ratio=1.0, **more):
    return preload(
        run_of(ratio, name=f"run {number}", measured_at=f"2026-01-{number:02d}T08:00:00", **more),
        calibrated(),
        run_of(name="base"),
    )


DENT = {"ratio": lambda x: np.where(np.abs(x - 0.225) < 0.05, 0.6, 0.9), "local": True}
WORN = day(1, 0.6)


def test_cells_and_fit_are_what_was_fused(tmp_path) -> None:
    figure = draw_preload(WORN)
    cells = figure.axes[0]
    shown = {bars.get_label(): bars.lines[0].get_ydata() for bars in cells.containers}
    for condition in ("PA", "PD", "NA", "ND"):
        mine = [c == condition for c in WORN.change.condition]
        np.testing.assert_allclose(shown[condition], 100 * WORN.change.y[mine])
    (fit,) = [line for line in cells.get_lines() if line.get_label() == "fit of one preload"]
    np.testing.assert_allclose(fit.get_ydata().max(), 100 * WORN.fused.level * WORN.change.nut_share.max())
    assert "2026-01-01 08:00\naxial stiffness as with 60 %" in figure.get_suptitle()
    assert_nothing_leaves_the_picture(figure)
    assert_the_same_file_twice(lambda: draw_preload(WORN), tmp_path)


def test_terms_and_causes_are_those_of_the_estimate() -> None:
    figure = draw_preload(WORN)
    widths = [bar.get_width() for bar in figure.axes[1].patches]
    assert widths == pytest.approx([t.standard_uncertainty for t in WORN.terms][: len(widths)])
    chances = [bar.get_width() for bar in figure.axes[2].patches]
    assert chances == pytest.approx([cause.probability for cause in WORN.causes])


def test_a_refused_run_is_named_as_such_or_has_no_picture() -> None:
    with pytest.raises(InputError, match="nothing to draw"):
        draw_preload(day(2, quality=Quality("bad", ("clipped",))))
    assert "no preload estimate" in draw_preload(day(3, level=0.15)).get_suptitle()


def test_the_map_shows_every_run_and_hatches_the_refused(tmp_path) -> None:
    runs = [day(1), day(5, 0.9), day(9, quality=Quality("bad", ("clipped",))), day(20, **DENT)]
    figure = draw_preload_map(runs[::-1])
    (mesh,) = [c for c in figure.axes[1].collections if hasattr(c, "get_coordinates")]
    values = np.ma.getdata(mesh.get_array()).reshape(11, 4)
    np.testing.assert_allclose(values[:, 1], [ratio.value for ratio in runs[1].profile.ratio])
    assert mesh.get_array().mask.reshape(11, 4)[:, 2].all()
    framed = [line for line in figure.axes[1].get_lines() if len(line.get_xdata()) == 5]
    assert len(framed) == 1
    assert "time (days)" in texts(figure)
    assert_the_same_file_twice(lambda: draw_preload_map(runs), tmp_path)


def test_a_map_that_cannot_be() -> None:
    with pytest.raises(InputError, match="two runs or more"):
        draw_preload_map([WORN])
    with pytest.raises(InputError, match="different baselines"):
        draw_preload_map([WORN, preload(run_of(0.8), calibrated())])
    bad = day(2, quality=Quality("bad", ("clipped",)))
    with pytest.raises(InputError, match="nothing to draw"):
        draw_preload_map([bad, bad])


def test_runs_without_times_are_numbered() -> None:
    two = [preload(run_of(r, name=str(r)), calibrated(), run_of(name="base")) for r in (0.9, 0.8)]
    assert "run" in texts(draw_preload_map(two))


def test_a_condition_without_cells_has_no_points() -> None:
    run, base = run_of(0.8), run_of(name="base")
    departures = tuple(cell for cell in run.cells if cell.condition.endswith("A"))
    found = preload(replace(run, cells=departures), calibrated(), base)
    bars = [each.get_label() for each in draw_preload(found).axes[0].containers]
    assert {label for label in bars if label in ("PA", "PD", "NA", "ND")} == {"PA", "NA"}
