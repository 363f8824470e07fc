from __future__ import annotations

import sys
from pathlib import Path

import pytest

from ballscrew.base.errors import InputError
from ballscrew.report.canvas import blank, colours_of, label_ends, note, save_figure, second_scale, styled

pytest.importorskip("matplotlib")

from matplotlib import pyplot as plt


def simple_figure():
    with styled():
        figure = blank(4, 3)
        axes = figure.subplots()
        axes.plot([0, 1], [0, 10])
        axes.set(xlim=(0, 1), ylim=(0, 10))
    return figure


def test_pyplot_knows_nothing_and_the_settings_are_as_before(tmp_path):
    before, size = plt.get_fignums(), plt.rcParams["axes.spines.top"]
    save_figure(simple_figure(), tmp_path / "a.png")
    assert plt.get_fignums() == before
    assert plt.rcParams["axes.spines.top"] == size


@pytest.mark.parametrize("name", ["a.jpg", "a", ".png"])
def test_a_wrong_ending_is_refused(tmp_path, name):
    with pytest.raises(InputError, match=r"must end in \.png, \.svg, \.pdf"):
        save_figure(simple_figure(), tmp_path / name)


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        save_figure(simple_figure(), tmp_path / "no" / "a.png")


def test_a_disk_that_is_full_is_said(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match=r"a\.png: cannot be written \(No space left on device\)"):
        save_figure(simple_figure(), tmp_path / "a.png")


def test_without_matplotlib_the_error_names_the_package_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(InputError, match=r"install ballscrew\[plot\]"), styled():
        pass


def test_labels_that_would_touch_are_separated_in_their_order():
    figure = simple_figure()
    axes = figure.axes[0]
    with styled():
        label_ends(axes, [5.0, 5.05, 4.95, 9.0], ["b", "a", "c", "z"], ["black"] * 4)
    figure.draw_without_rendering()
    boxes = {text.get_text(): text.get_window_extent() for text in axes.texts}
    assert boxes["c"].y1 <= boxes["b"].y0 + 1
    assert boxes["b"].y1 <= boxes["a"].y0 + 1
    assert [text.xy[1] for text in axes.texts if text.get_text() == "z"] == [9.0], "nobody is near"
    assert [text.xy[1] for text in axes.texts if text.get_text() == "b"] == pytest.approx([5.0], abs=0.05)


@pytest.mark.parametrize(
    ("offset", "ha", "va"),
    [((4, 4), "left", "bottom"), ((-4, -4), "right", "top"), ((0, 0), "center", "center")],
)
def test_a_note_grows_away_from_its_point(offset, ha, va):
    axes = simple_figure().axes[0]
    note(axes, "words", (0.5, 5), offset)
    (text,) = axes.texts
    assert (text.get_ha(), text.get_va()) == (ha, va)


def test_the_second_scale_is_the_first_times_a_factor():
    figure = simple_figure()
    second_scale(figure.axes[0], 3.0, "thrice (N)")
    figure.draw_without_rendering()
    (other,) = figure.axes[0].child_axes
    assert other.get_ylim() == pytest.approx((0, 30))
    assert other.get_ylabel() == "thrice (N)"


def test_colours_are_as_many_as_asked_and_none_is_too_light():
    for count in (1, 2, 6):
        colours = colours_of("plasma", count, 0.75)
        assert len(set(colours)) == count
        assert all(0.2126 * r + 0.7152 * g + 0.0722 * b < 0.75 for r, g, b, _ in colours)
