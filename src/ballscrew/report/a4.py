"""Texts, bars and strips at places in mm on an A4 page, and lines by the widths of their letters."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from ballscrew.report.blocks import StateStrip, height_of, look_of, single_line
from ballscrew.report.canvas import Figure

WIDTH, HEIGHT = 297.0, 210.0
"""Size of a page in landscape format, mm."""
INCH = 25.4
"""An inch, mm."""
TEXT, SOFT = "#222222", "#5a5a5a"
"""Colours of texts."""
STRIP = 5.2
"""Height of a strip, mm."""
_POINT = INCH / 72
_LINE = 1.32  # letter heights from one line to the next
_EM = 100.0  # points, at which the letters are measured

Drawing = Callable[[Figure], None]
"""Draws a part of a page."""


def words_at(
    text: str,
    x: float,
    y: float,
    size: float,
    *,
    colour: str = TEXT,
    weight: str = "normal",
    align: str = "left",
) -> Drawing:
    """A line of text at a place in mm from the upper left corner; dollars are no formula."""

    def draw(figure: Figure) -> None:
        look: Any = {"color": colour, "fontweight": weight, "ha": align, "parse_math": False}
        figure.text(x / WIDTH, 1 - y / HEIGHT, text, fontsize=size, va="baseline", **look)

    return draw


def bar_at(x: float, y: float, width: float, height: float, colour: str) -> Drawing:
    """A filled rectangle; its upper left corner and size are in mm."""

    def draw(figure: Figure) -> None:
        from matplotlib.patches import Rectangle

        place = (x / WIDTH, 1 - (y + height) / HEIGHT)
        figure.add_artist(
            Rectangle(place, width / WIDTH, height / HEIGHT, fc=colour, lw=0, transform=figure.transFigure)
        )

    return draw


def strip_at(strip: StateStrip, x: float, y: float, width: float) -> Drawing:
    """A strip of states; its upper left corner and width are in mm."""

    def draw(figure: Figure) -> None:
        bar_at(x, y, width, STRIP, "#f0f0f0")(figure)
        for begin, end, state in strip.parts:
            height = STRIP * height_of(state)
            place = (x + width * begin, y + STRIP - height)
            bar_at(*place, width * (end - begin), height, look_of(state)[1])(figure)

    return draw


def pitch(size: float) -> float:
    """Distance of two lines, mm."""
    return _LINE * size * _POINT


def rise(size: float) -> float:
    """From the upper end of a line to its base, mm."""
    return size * _POINT


def wrapped(text: str, width: float, size: float, *, bold: bool = False) -> list[str]:
    """Lines of a text that are no wider than a width in mm; a long word is divided."""
    lines, line, used = [], "", 0.0
    space = _advance(" ", bold) * size * _POINT
    for word in single_line(text).split(" "):
        for piece in _pieces(word, width, size, bold=bold):
            wide = sum(_advance(letter, bold) for letter in piece) * size * _POINT
            if line and used + space + wide > width:
                lines.append(line)
                line, used = "", 0.0
            if line:
                line, used = f"{line} {piece}", used + space + wide
            else:
                line, used = piece, wide
    return [*lines, line]


def _pieces(word: str, width: float, size: float, *, bold: bool) -> list[str]:
    """A word, or parts of it where it is wider than a line."""
    pieces, piece, used = [], "", 0.0
    for letter in word:
        wide = _advance(letter, bold) * size * _POINT
        if piece and used + wide > width:
            pieces.append(piece)
            piece, used = "", 0.0
        piece, used = piece + letter, used + wide
    return [*pieces, piece]


@lru_cache(maxsize=10_000)
def _advance(letter: str, bold: bool) -> float:
    """Width of a letter relative to its size."""
    from matplotlib.font_manager import FontProperties, findfont, get_font

    font = get_font(findfont(FontProperties(weight="bold" if bold else "normal")))
    font.set_size(_EM, 72)
    glyph = font.load_glyph(font.get_char_index(ord(letter)))  # a box where the font has none
    return float(glyph.linearHoriAdvance) / 65536 / _EM
