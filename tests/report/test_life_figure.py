from __future__ import annotations

import pytest

from ballscrew.base.quantity import Quantity
from ballscrew.report.canvas import STATE_COLOURS, STATE_MARKERS, STATE_SIGNS, save_figure
from ballscrew.report.life_figure import LifePoint, draw_life
from ballscrew.report.page import html_page, state_words


def ratio(value: float) -> Quantity:
    return Quantity(value, 0.02, "", (value - 0.05, value + 0.04))


POINTS = [
    LifePoint(0.0, "learning", ratio(1.0), 1.0, 0.0),
    LifePoint(3.0, "normal", ratio(0.95), 0.97, 0.0),
    LifePoint(6.0, "alarm", ratio(0.8), 0.82, 0.0),
    LifePoint(9.0, "suspect", None, 0.1, 0.0),
    LifePoint(12.0, "suspect", None, 0.0, 1e-6),
]


@pytest.fixture(autouse=True)
def _matplotlib():
    pytest.importorskip("matplotlib")


def test_the_same_picture_twice(tmp_path):
    for name in ("one.png", "two.png", "one.svg", "two.svg"):
        save_figure(draw_life(POINTS, alarm_day=6.0), tmp_path / name)
    for suffix in ("png", "svg"):
        one, two = ((tmp_path / f"{name}.{suffix}").read_bytes() for name in ("one", "two"))
        assert one == two
        assert len(one) > 5000


def test_what_it_shows():
    figure = draw_life(POINTS, alarm_day=6.0)
    preload, backlash = figure.axes
    assert [axes.get_ylabel() for axes in figure.axes] == ["preload (% of the baseline)", "backlash (µm)"]
    notes = [text.get_text() for text in preload.texts]
    assert notes == ["no estimate", "alarm: day 6", "backlash: day 12"]
    assert list(preload.lines[0].get_ydata()) == pytest.approx([100, 97, 82, 10, 0])
    names = {text.get_text() for text in preload.get_legend().get_texts()}
    assert names == {"true", "no estimate", "estimated: learning", "estimated: normal", "estimated: alarm"}
    assert list(backlash.lines[0].get_ydata()) == pytest.approx([0, 0, 0, 0, 1])


def test_without_an_alarm_and_without_backlash():
    preload, _ = draw_life(POINTS[:3], alarm_day=None).axes
    assert not list(preload.texts)
    assert "no estimate" not in {text.get_text() for text in preload.get_legend().get_texts()}


def test_a_page_escapes_what_it_is_given():
    page = html_page(
        "a < b", ["<script>"], [("x.png", 'a "b"')], ["n & m"], [["<1>", "2"]], conclusion="1 < 2"
    )
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert '<img src="x.png" alt="a &quot;b&quot;">' in page
    assert "<td>&lt;1&gt;</td><td>2</td>" in page
    assert page.count("<tr>") == 2
    assert page.index('<p class="conclusion">1 &lt; 2</p>') < page.index("&lt;script&gt;")
    assert 'name="viewport"' in page


@pytest.mark.parametrize("state", sorted(STATE_SIGNS))
def test_a_state_has_a_sign_and_a_word_besides_its_colour(state):
    page = html_page("Axis", [], [], ["state"], [[state_words(state)]], conclusion=f"{state}!", lamp=state)
    sign = STATE_SIGNS[state]
    assert f'aria-hidden="true">{sign}</span> {state}!' in page
    assert f"<td>{sign} {state}</td>" in page
    assert f"--lamp: {STATE_COLOURS[state]}" in page
    assert sum(sign == other for other in STATE_SIGNS.values()) == 1
    assert sum(STATE_MARKERS[state] == other for other in STATE_MARKERS.values()) == 1


def test_a_table_of_sentences_stands_before_the_pictures():
    given = ("title", ["text"], [("a.png", "caption")], ["claim"], [["it <falls>"]])
    numbers, words = html_page(*given), html_page(*given, words=True)
    assert numbers.index("a.png") < numbers.index("it &lt;falls&gt;")
    assert words.index("it &lt;falls&gt;") < words.index("a.png")
    assert 'class="words"' in words
    assert '<table class="words"' not in numbers
