from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Limits, Screw, Table
from ballscrew.base.errors import InputError
from ballscrew.fcft.excitation import mean_blow_spectrum
from ballscrew.fcft.expected import executed
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.planned import plan
from ballscrew.report.canvas import CONDITION_COLOURS, FORMATS, save_figure
from ballscrew.report.plan_figure import draw_plan

colors = pytest.importorskip("matplotlib.colors")
figures = pytest.importorskip("matplotlib.figure")
image = pytest.importorskip("matplotlib.image")

SHEET = DataSheet(
    name="bench",
    support="fixed-free",
    screw=Screw(0.01, 0.0176, 0.0176, 0.65, 0.08, 15e3, 480e6, 0.1, 0.04),
    bearing=Bearing(160e6),
    table=Table(32.0),
    drive=Drive(4.2e-4),
    guide=Guide(25.0),
    source="axis.toml",
)
BENCH = Motion(0.15, 2.5, 1500.0, 0.35)
NULL = replace(BENCH, jerk=375.0)
PLAN = Plan(tuple(0.045 * index for index in range(11)), 3, (100.0,), (BENCH,))
SIGNATURE = {".png": b"\x89PNG\r\n\x1a\n", ".pdf": b"%PDF-", ".svg": b"<?xml"}
PANELS = (
    "One round trip", "Arriving at a stop", "Leaving it", "Torque excitation of one jerk phase", "Nut load",
    "As the preload falls", "Expected axial natural frequency",
)  # fmt: skip


def planned(test=PLAN, sheet=SHEET):
    return plan(test, axis=sheet)


def write_plan(test, path):
    save_figure(draw_plan(test), path)


def draw(test=PLAN, sheet=SHEET):
    """Figure of a plan, not rendered yet."""
    return draw_plan(planned(test, sheet))


@pytest.fixture(scope="module")
def bench_figure():
    """Figure of the bench's plan."""
    figure = draw_plan(planned())
    figure.draw_without_rendering()
    return figure


def panel(figure, title):
    (axes,) = [axes for axes in figure.axes if axes.get_title("left").startswith(title)]
    return axes


def words(figure):
    """All texts of a figure and its parts."""
    return "\n".join(text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text")))


def lines(axes, colour):
    return [line for line in axes.get_lines() if colors.same_color(line.get_color(), colour)]


@pytest.mark.parametrize("ending", FORMATS)
def test_a_picture_in_each_format_and_the_same_bytes_again(tmp_path, ending):
    digests = []
    for name in ("a", "b"):
        path = tmp_path / f"{name}{ending}"
        write_plan(planned(), path)
        content = path.read_bytes()
        assert content.startswith(SIGNATURE[ending])
        digests.append(hashlib.sha256(content).hexdigest())
    assert digests[0] == digests[1]
    if ending == ".png":
        pixels = image.imread(path)
        assert pixels.shape[:2] == pytest.approx((10.5 * 150, 15 * 150), abs=2)
        assert len(np.unique(pixels[::5, ::5, :3].reshape(-1, 3), axis=0)) > 50, "it is not empty"
    elif ending == ".svg":
        assert ET.fromstring(content).tag.endswith("svg")  # noqa: S314  our own file


def test_what_is_written(bench_figure):
    text = words(bench_figure)
    assert "Plan for bench: 40 cells, 3 round trips, 43.8 s" in text
    assert "11 stops from 0 to 450 mm;  load 100 kg;  150 mm/s, 2.5 m/s², 1500 m/s³, dwell 350 ms" in text
    for label in (
        "position (mm)", "speed (mm/s)", "time (s)", "acceleration (m/s²)", "frequency (Hz)",
        "nut load F (N)", "preload P (N)", "P (% of Ca)", "ANF, rotor free (Hz)",
        "expected ANF ± 2 u", "load (kg)",
        *(f"{condition}  {there}/{how}" for condition, there, how in (
            ("PA", "positive", "acceleration"), ("PD", "positive", "deceleration"),
            ("NA", "negative", "acceleration"), ("ND", "negative", "deceleration"),
        )), *PANELS,
    ):  # fmt: skip
        assert label in text
    assert "Warning" not in text
    assert "Limit broken" not in text


def test_the_round_trip_visits_every_stop_and_comes_back(bench_figure):
    axes = panel(bench_figure, "One round trip")
    (whole,) = lines(axes, "0.55")
    time, place = whole.get_data()
    assert (time[0], time[-1]) == pytest.approx((0.0, 14.5833), abs=1e-3)
    assert (place[0], place.max(), place[-1]) == pytest.approx((0.0, 450.0, 0.0), abs=1e-9)
    assert (np.diff(time) >= 0).all()


@pytest.mark.parametrize(("condition", "way", "speeds_up"), [
    ("PA", 1, True), ("PD", 1, False), ("NA", -1, True), ("ND", -1, False),
])  # fmt: skip
def test_each_condition_has_its_colour_where_it_happens(bench_figure, condition, way, speeds_up):
    axes = bench_figure.axes[1]
    assert axes.get_ylabel() == "speed (mm/s)"
    (coloured,) = lines(axes, CONDITION_COLOURS[condition])
    _, speed = coloured.get_data()
    runs = np.ma.clump_unmasked(np.ma.masked_invalid(speed))
    assert len(runs) == 10, "one per move"
    for run in runs:
        part = speed[run]
        assert (way * part >= -1e-9).all()
        assert (way * (part[-1] - part[0]) > 0) == speeds_up
        assert abs(part).max() == pytest.approx(150.0)
        assert abs(part).min() == pytest.approx(0.0, abs=1e-9)


def test_the_null_is_marked_and_named():
    figure = draw(replace(PLAN, motions=(NULL,)))
    axes = panel(figure, "Torque")
    (rings,) = [line for line in axes.get_lines() if line.get_marker() == "o"]
    assert rings.get_xdata() == pytest.approx([150.0, 300.0])
    named = [text.get_text() for text in axes.texts]
    assert "1/$T_j$\n150 Hz" in named
    assert "2/$T_j$\n300 Hz" in named
    assert any(line.get_ydata()[0] == pytest.approx(150.0) for line in panel(figure, "Expected").get_lines())
    assert "Warning: the motion: the torque has a null at 150.0 Hz" in words(figure).replace("\n", " ")


def test_the_excitation_of_varied_repetitions_is_their_mean():
    varied = replace(PLAN, repetitions=8, motions=(replace(NULL, jerk_spread=0.5),))
    axes = panel(draw(varied), "Torque")
    (thick,) = [line for line in axes.get_lines() if "rms of 8" in str(line.get_label())]
    frequency, height = thick.get_data()
    assert height == pytest.approx(mean_blow_spectrum(frequency, executed(varied, 0)))
    assert height.min() > 0.02, "no null is left"


def test_the_band_is_that_of_all_stops_and_loads():
    several = replace(PLAN, masses=(0.0, 100.0))
    cells = planned(several).cells
    figure = draw(several)
    spans = [patch.get_extents().transformed(panel(figure, "Torque").transData.inverted())
             for patch in panel(figure, "Torque").patches]  # fmt: skip
    low = min(cell.frequency - 2 * cell.standard_uncertainty for cell in cells)
    high = max(cell.frequency + 2 * cell.standard_uncertainty for cell in cells)
    assert min(span.x0 for span in spans) == pytest.approx(low)
    assert max(span.x1 for span in spans) == pytest.approx(high)


def test_nut_loads_and_the_preloads_that_they_ask_for(bench_figure):
    figure = bench_figure
    bars = panel(figure, "Nut load").patches
    heights = {colors.to_hex(bar.get_facecolor()): bar.get_height() for bar in bars}
    wanted = {"PA": 355.0, "PD": -305.0, "NA": -355.0, "ND": 305.0}
    assert heights == pytest.approx({CONDITION_COLOURS[c].lower(): force for c, force in wanted.items()})
    levels = {round(abs(line.get_ydata()[0])) for line in panel(figure, "Nut load").get_lines()}
    assert {900, 1697} <= levels, "1.5 P and 2.83 P of 600 N"
    assert "237 N (1.58% of Ca) and 126 N (0.84%)" in words(figure)
    unloaded, low = panel(figure, "As the preload").patches
    assert (unloaded.get_height(), low.get_y() + low.get_height()) == pytest.approx((125.5, 236.7), abs=0.1)


def test_the_expected_frequency_along_the_axis():
    masses = (0.0, 50.0, 100.0)
    axes = panel(draw(replace(PLAN, masses=masses)), "Expected")
    cells = planned(replace(PLAN, masses=masses)).cells
    for mass in masses:
        (line,) = [line for line in axes.get_lines() if line.get_label() == f"{mass:g} kg"]
        f = {c.position: c.frequency for c in cells if c.mass == mass}
        assert line.get_xdata() == pytest.approx([1e3 * position for position in f])
        assert line.get_ydata() == pytest.approx(list(f.values()))
    assert len(axes.collections) == 3, "one band per load"


def test_warnings_and_broken_limits_are_written_beneath():
    hard = replace(PLAN, motions=(replace(BENCH, dwell=0.05, acceleration=12.0, jerk=6000.0),))
    text = words(draw(hard, replace(SHEET, limits=Limits(speed=0.1)))).replace("\n", " ")
    assert "Limit broken: the plan: motion.speed is 0.15 m/s" in text
    assert "Warning: the motion: the dwell of 50 ms" in text
    assert "limit 100 mm/s" in text


def test_of_very_many_warnings_the_rest_is_counted():
    motions = tuple(replace(NULL, dwell=0.01 + 0.001 * index) for index in range(10))
    assert len(planned(replace(PLAN, motions=motions)).warnings) == 20
    assert "… and 16 more." in words(draw(replace(PLAN, motions=motions)))


def test_near_soft_limits_are_shown():
    assert "limit: highest position 460 mm" in words(draw(sheet=replace(SHEET, limits=Limits(-0.01, 0.46))))
    assert "limit: highest position" not in words(draw(sheet=replace(SHEET, limits=Limits(-0.01, 50.0))))


SLOW = Motion(0.01, 0.5, 600.0, 0.35)


PLANS = {
    "two stops": (replace(PLAN, positions=(0.0, 0.4), repetitions=1), SHEET),
    "30 loads": (replace(PLAN, masses=tuple(10.0 * i for i in range(30))), SHEET),
    "warm-up": (replace(PLAN, masses=(0.0, 9.0), motions=(BENCH, NULL), warm_up=2, temperature=True), SHEET),
    "triangle": (replace(PLAN, motions=(Motion(0.1, 10.0, 200.0, 0.3),)), SHEET),
    "nut unloaded": (replace(PLAN, motions=(Motion(0.15, 60.0, 1e5, 0.35),)), SHEET),
    "all limits broken": (PLAN, replace(SHEET, limits=Limits(0.1, 0.2, 0.01, 0.01))),
}
FURTHER_PLANS = {
    "1000 stops": (
        replace(PLAN, positions=tuple(round(0.0005 * i, 6) for i in range(1000)), motions=(SLOW,)),
        SHEET,
    ),
    "9 motions": (
        replace(PLAN, motions=tuple(replace(BENCH, jerk=400.0 + 200 * i) for i in range(9))),
        SHEET,
    ),
    "no dwell": (replace(PLAN, motions=(replace(BENCH, dwell=0.0),)), SHEET),
    "an hour's dwell": (replace(PLAN, motions=(replace(BENCH, dwell=3600.0, start_spread=60.0),)), SHEET),
    "2000 repetitions": (
        replace(PLAN, repetitions=2000, motions=(replace(NULL, jerk_spread=1.0, start_spread=1.0),)),
        SHEET,
    ),
    "a jerk of seconds": (
        replace(PLAN, positions=(0.0, 0.5), motions=(Motion(0.01, 1.0, 0.05, 0.3),)),
        SHEET,
    ),
    "no jerk time": (replace(PLAN, motions=(replace(BENCH, jerk=1e9),)), SHEET),
    "hardly sure": (
        PLAN,
        replace(SHEET, support="fixed-fixed", tolerances={"rigidity": 1.0, "stiffness": 1.0}),
    ),
    "sure": (PLAN, replace(SHEET, tolerances={"rigidity": 0.0, "stiffness": 0.0, "preload_ratio": 0.0})),
    "stuck": (PLAN, replace(SHEET, guide=Guide(1e6))),
}


@pytest.mark.parametrize(
    ("test", "sheet"),
    [
        *PLANS.values(),
        *(pytest.param(*each, marks=pytest.mark.slow) for each in FURTHER_PLANS.values()),
    ],
    ids=[*PLANS, *FURTHER_PLANS],
)
def test_any_plan_has_a_picture(test, sheet):
    figure = draw(test, sheet)
    figure.draw_without_rendering()
    titles = "\n".join(axes.get_title("left") for axes in figure.axes)
    for title in PANELS[1:]:
        assert title in titles
    for axes in figure.axes:
        box = axes.get_position()
        assert box.width > 0.05, axes.get_title("left")
        assert box.height > 0.1, axes.get_title("left")
        assert np.isfinite([*axes.get_xlim(), *axes.get_ylim()]).all()


def test_of_a_long_trip_the_turn_is_shown_large():
    stops = tuple(round(0.005 * index, 6) for index in range(100))
    figure = draw(replace(PLAN, positions=stops, motions=(Motion(0.04, 1.0, 600.0, 0.35),)))
    place, speed = figure.axes[:2]
    begin, end = speed.get_xlim()
    assert 0 < begin < place.get_xlim()[1] / 2 < end
    assert "6 moves around the turn" in words(figure)


NAMES = {
    "formula": "$\\frac{", "dollars": "$x$ $", "long": "a" * 5000, "signs": "轴 1 \U0001f600",
    "control": "\x00\x1b[31m\n\t", "markup": "<svg>&amp;", "backslash": "\\", "formats": "%s {0} _^~#",
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "ending"),
    [
        *(pytest.param(name, ".svg", marks=pytest.mark.slow) for name in NAMES.values()),
        ("".join(NAMES.values()), ".svg"),
        ("".join(NAMES.values()), ".pdf"),
        ("".join(NAMES.values()), ".png"),
    ],
    ids=[*NAMES, "all as SVG", "all as PDF", "all as PNG"],
)
def test_any_name_has_a_picture(tmp_path, name, ending):
    path = tmp_path / f"plan{ending}"
    broken = replace(SHEET, name=name, source=name, limits=Limits(speed=0.1))
    write_plan(planned(replace(PLAN, source=name), broken), path)
    if ending == ".svg":
        assert ET.parse(path).getroot().tag.endswith("svg")  # noqa: S314  our own file


def test_a_formula_in_a_name_stays_as_it_is():
    assert r"Plan for \$\frac{1}{2}\$:" in words(draw(sheet=replace(SHEET, name=r"$\frac{1}{2}$")))


@pytest.mark.parametrize("name", ["plan.jpg", "plan", "plan.png.txt"])
def test_a_wrong_ending_is_refused(tmp_path, name):
    with pytest.raises(InputError, match=r"a picture's name must end in \.png, \.svg, \.pdf"):
        write_plan(planned(), tmp_path / name)
    assert not (tmp_path / name).exists()


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        write_plan(planned(), tmp_path / "no" / "plan.png")


def test_a_disk_that_is_full_is_said(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match=r"plan\.png: cannot be written \(No space left on device\)"):
        write_plan(planned(), tmp_path / "plan.png")


def test_the_look_of_other_figures_is_left_alone(tmp_path):
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    write_plan(planned(), tmp_path / "plan.png")
    assert dict(mpl.rcParams) == before


def test_many_nulls_are_stated_by_their_spacing():
    """The speed is reached after a jerk phase of √(0.15 / 5) s."""
    slow = replace(BENCH, jerk=5.0)
    figure = draw(replace(PLAN, positions=(0.0, 0.225, 0.45), motions=(slow,)))
    axes = panel(figure, "Torque")
    assert "nulls every 5.77 Hz" in [text.get_text() for text in axes.texts]
    assert not [line for line in axes.get_lines() if line.get_marker() == "o"]
    names = [text.get_text() for text in panel(figure, "Expected").texts]
    assert any(words.startswith("nulls of ") and words.endswith(" every 5.77 Hz") for words in names)
