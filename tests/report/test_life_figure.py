from __future__ import annotations

import pytest

from ballscrew.base.errors import InputError
from ballscrew.report import life_figure
from ballscrew.report.canvas import styled
from ballscrew.report.life_figure import LifePoint, draw_life
from ballscrew.report.page import html_page

POINTS = [
    LifePoint(0.0, 0.05, 0.1, 40, 0.04, 0.0),
    LifePoint(3.0, -0.5, 0.1, 40, 0.03, 0.0),
    LifePoint(6.0, -4.0, 0.1, 38, 0.01, 0.0),
    LifePoint(9.0, None, 0.1, 0, 0.0, 0.0),
    LifePoint(12.0, None, 0.1, 0, 0.0, 1e-6),
]


@pytest.fixture(autouse=True)
def _matplotlib():
    pytest.importorskip("matplotlib")


def test_the_same_picture_twice(tmp_path):
    for name in ("one.png", "two.png", "one.svg", "two.svg"):
        draw_life(POINTS, tmp_path / name, alarm_day=6.0)
    for suffix in ("png", "svg"):
        one, two = ((tmp_path / f"{name}.{suffix}").read_bytes() for name in ("one", "two"))
        assert one == two
        assert len(one) > 5000


def test_what_it_shows():
    with styled():
        figure = life_figure._figure(POINTS, 6.0)
        measured, preload, backlash = figure.axes
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "change of the\nnatural frequency (Hz)", "preload\n(% of $C_a$)", "backlash (µm)",
    ]  # fmt: skip
    said = [text.get_text() for text in measured.texts]
    assert said == ["not told: the test's own load unloads the nut", "sure: day 6", "backlash: day 12"]
    assert list(preload.lines[0].get_ydata()) == [4.0, 3.0, 1.0, 0.0, 0.0]
    assert list(backlash.lines[0].get_ydata()) == pytest.approx([0, 0, 0, 0, 1])


def test_without_an_alarm_and_without_backlash(tmp_path):
    draw_life(POINTS[:3], tmp_path / "a.png", alarm_day=None)
    with pytest.raises(InputError, match="must end in"):
        draw_life(POINTS, tmp_path / "a.doc", alarm_day=None)


def test_a_page_escapes_what_it_is_given():
    page = html_page("a < b", ["<script>"], [("x.png", 'a "b"')], ["n & m"], [["<1>", "2"]])
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert '<img src="x.png" alt="a &quot;b&quot;">' in page
    assert "<td>&lt;1&gt;</td><td>2</td>" in page
    assert page.count("<tr>") == 2
