"""Blocks are laid out on pages: nothing is wider than its column, nothing is lost, tables go on."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.report import canvas
from ballscrew.report.a4 import _advance, wrapped
from ballscrew.report.blocks import (
    AxisLink,
    ItemList,
    PageHeading,
    ReportTable,
    SectionHeading,
    Sentences,
    StateStrip,
    StateWords,
    TableColumn,
    single_line,
)
from ballscrew.report.pdf_pages import write_pdf

POINT = 25.4 / 72


@settings(deadline=None)
@given(st.text(max_size=200), st.floats(8.0, 100.0), st.booleans())
def test_lines_are_no_wider_than_their_column_and_no_letter_is_lost(
    text: str, width: float, bold: bool
) -> None:
    with canvas.styled():  # in which a missing glyph is no warning
        lines = wrapped(text, width, 9.0, bold=bold)
    for line in lines:
        assert sum(_advance(letter, bold) for letter in line) * 9.0 * POINT <= width + 1e-6 or len(line) == 1
    assert "".join(lines).replace(" ", "") == single_line(text).replace(" ", "")


def test_a_long_table_goes_on_with_its_heading_on_the_next_page(tmp_path: Path) -> None:
    columns = (TableColumn("heading", 1.0), TableColumn("number", 1.0, right=True))
    rows = tuple((f"row {number}", str(number)) for number in range(100))
    blocks = [PageHeading("title", "below", "a"), ReportTable(columns, rows)]
    assert write_pdf(tmp_path / "a.pdf", "title", blocks) == 4


def test_every_block_can_be_written_and_a_cell_without_end_is_cut(tmp_path: Path) -> None:
    strip = StateStrip(((0.0, 0.5, "normal"), (0.6, 1.0, "alarm")))
    row = (StateWords("no such state", "unknown"), AxisLink("x", "a"), strip, "word " * 10_000)
    columns = tuple(TableColumn(title, 1.0) for title in ("state", "axis", "year", "text"))
    blocks = [
        PageHeading("title", "below", "a"), SectionHeading("section"), StateWords("alarm", "ALARM"),
        Sentences("text"), Sentences("text", soft=True), ItemList(("one", "two")),
        ReportTable(columns, (row,)),
    ]  # fmt: skip
    assert write_pdf(tmp_path / "a.pdf", "title", blocks) == 1


def test_a_pdf_is_the_same_at_any_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = [PageHeading("title", "below", "a"), Sentences("text")]
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    write_pdf(tmp_path / "a.pdf", "title", blocks)
    write_pdf(tmp_path / "b.pdf", "title", blocks)
    content = (tmp_path / "a.pdf").read_bytes()
    assert content == (tmp_path / "b.pdf").read_bytes()
    assert str(datetime.now(UTC).year).encode() not in content


def test_a_folder_is_no_pdf(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a folder"):
        write_pdf(tmp_path, "title", [Sentences("text")])
