"""The two schematics, and the copies of them in the documentation."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

from docs.pictures.processing import STEPS, draw_processing
from docs.pictures.testbed import draw_testbed
from tests.report.axis_m import assert_nothing_leaves_the_picture, assert_the_same_file_twice, texts

from ballscrew.report.canvas import save_figure

ROOT = Path(__file__).parent.parent.parent.parent
SCHEMATICS = {"processing": draw_processing, "testbed_schematic": draw_testbed}


@pytest.mark.parametrize("draw", SCHEMATICS.values(), ids=SCHEMATICS)
def test_room_and_the_same_file(draw, tmp_path):
    assert_nothing_leaves_the_picture(draw())
    assert_the_same_file_twice(draw, tmp_path)


def no_two_texts_overlap(figure):
    from matplotlib.text import Text

    figure.draw_without_rendering()
    boxes = [
        (text.get_text(), text.get_window_extent())
        for text in figure.findobj(Text)
        if text.get_text().strip()
        and text.get_visible()
        and text.axes is not None
        and text.axes.axison is False
    ]
    ticks = {
        label.get_text()
        for axes in figure.axes
        for label in (*axes.get_xticklabels(), *axes.get_yticklabels())
    }
    boxes = [(words, box) for words, box in boxes if words not in ticks]
    return [
        (a, b) for i, (a, first) in enumerate(boxes) for b, second in boxes[i + 1 :] if first.overlaps(second)
    ]


@pytest.mark.parametrize("draw", SCHEMATICS.values(), ids=SCHEMATICS)
def test_words_do_not_lie_on_one_another(draw):
    assert no_two_texts_overlap(draw()) == []


def test_every_step_of_the_paper_and_of_ours_is_there():
    words = texts(draw_processing())
    for step in STEPS:
        assert step.here in words
        assert step.paper in words
        assert step.why in words
    for part in ("Hann window", "zero-padding, FFT", "mean of 30 FRFs", "cut off the steady state"):
        assert part in words


def test_a_step_that_the_paper_lacks_says_why():
    assert all(step.why for step in STEPS if not step.paper)


def test_the_five_bodies_and_their_symbols():
    words = texts(draw_testbed())
    page = (ROOT / "docs" / "explanation" / "testbed.md").read_text(encoding="utf-8")
    for symbol in ("u_m", "u_\\varphi", "u_s", "x_t", "x_b", "k_\\theta(x)", "k_a(x)"):
        assert symbol in words
        assert symbol in page


@pytest.mark.parametrize("name", SCHEMATICS)
@pytest.mark.parametrize("ending", [".png", ".svg"])
def test_the_documentation_holds_what_is_drawn(name, ending, tmp_path):
    stored = ROOT / "docs" / "_static" / f"{name}{ending}"
    save_figure(SCHEMATICS[name](), tmp_path / f"new{ending}")
    if ending == ".png":
        assert stored.read_bytes()[16:24] == (tmp_path / "new.png").read_bytes()[16:24], (
            "run python -m docs.schematics"
        )
    else:
        sizes = [
            ET.parse(path).getroot().attrib["viewBox"]  # noqa: S314  our own files
            for path in (stored, tmp_path / "new.svg")
        ]
        assert sizes[0] == sizes[1], "run python -m docs.schematics"


def test_the_page_shows_the_testbed():
    page = (ROOT / "docs" / "explanation" / "testbed.md").read_text(encoding="utf-8")
    assert "_static/testbed_schematic.svg" in page
