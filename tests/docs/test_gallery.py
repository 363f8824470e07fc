"""The gallery shows simulated runs and quotes the program correctly."""

from __future__ import annotations

import re
import struct
from typing import Any

import pytest
from tests.docs.pages import DOCS, alike, load, page, section, words

from ballscrew.modal.run import Run

GALLERY = load(DOCS / "gallery.py")
ENTRIES: dict[str, Any] = GALLERY.ENTRIES
TEXT = page("docs/howto/read-frf.md")
AGAIN = "run python -m docs.gallery"
MADE = ("good", "late")
LEADS = ("Appearance.", "Cause.", "`ballscrew` reports", "Remedy.")


@pytest.fixture(scope="module")
def runs() -> dict[str, Run]:
    return {name: GALLERY.analysed(ENTRIES[name]) for name in MADE}


def row_of(name: str) -> str:
    return next(line for line in TEXT.splitlines() if line.startswith(f"| [{ENTRIES[name].title}]("))


def same(printed: str, shown: str) -> None:
    first, second = words(printed.replace(";", "")), words(shown.replace(";", ""))
    assert len(first) == len(second), f"{AGAIN}: {printed!r} is not {shown!r}"
    assert alike(first, second) == [], AGAIN


def test_the_page_shows_the_entries_of_the_script_in_their_order() -> None:
    titles = [entry.title for entry in ENTRIES.values()]
    assert re.findall(r"^## (.*)$", TEXT, re.M) == ["Summary", *titles, "Reproduce"]
    assert re.findall(r"^\| \[([^]]*)\]", TEXT, re.M) == titles
    assert re.findall(r"\{image\} \.\./_static/gallery-(\w+)\.png", TEXT) == list(ENTRIES)


def test_there_is_a_picture_for_each_entry_and_none_beside_that_fits_a_page() -> None:
    pictures = sorted((DOCS / "_static").glob("gallery-*.png"))
    assert {path.stem.removeprefix("gallery-") for path in pictures} == set(ENTRIES)
    for path in pictures:
        width, height = struct.unpack(">II", path.read_bytes()[16:24])
        assert (width, height) == (900, 750), path.name


@pytest.mark.parametrize("name", list(ENTRIES))
def test_each_entry_has_four_parts(name: str) -> None:
    text = section(TEXT, ENTRIES[name].title)
    assert re.findall(r"^\*\*([^*]+)\*\*", text, re.M) == list(LEADS)
    assert re.search(r"^:alt: .{20,}$", text, re.M)
    verdicts = re.findall(r"^> \*\*([^*:]+): (\w+)\*\*", text, re.M)
    entry = ENTRIES[name]
    cell = f"Cell at {1e3 * entry.position:g} mm, {entry.condition}"
    assert [subject for subject, _ in verdicts] == ["Measurement", cell]
    assert verdicts[0][1] == row_of(name).split("|")[2].strip()


@pytest.mark.parametrize("name", MADE)
def test_the_quotations_are_the_output_of_the_program(name: str, runs: dict[str, Run]) -> None:
    entry = ENTRIES[name]
    shown = re.findall(r"^>.*$", section(TEXT, entry.title), re.M)
    same(GALLERY.quoted(GALLERY.quotation(entry, runs[name])), "\n".join(shown))
    same(GALLERY.row(entry, runs[name]), row_of(name))


def test_the_picture_shows_the_verdict_and_the_true_frequency(runs: dict[str, Run]) -> None:
    entry = ENTRIES["late"]
    upper, phase, _ = GALLERY.draw(entry, runs["late"], runs["good"]).axes
    cell = GALLERY.cell_of(runs["late"], entry.position, entry.condition)
    assert (upper.get_title("left"), upper.get_title("right")) == (entry.title, cell.verdict)
    assert f"true {entry.true:.1f} Hz" in upper.get_legend_handles_labels()[1]
    grey, *own = (float(line.get_ydata()[-1]) for line in phase.lines[:3])
    # 2 ms at the right edge are 230°, less the whole turn.
    assert all(abs((x - grey - 2e-3 * 360 * GALLERY.SHOWN[1] + 180) % 360 - 180) < 5 for x in own)


def test_only_quotations_and_rows_are_replaced() -> None:
    quotations = {"noise": ["**Measurement: odd**.", "**Cell: odd**."]}
    new = GALLERY.written(TEXT, quotations, {"noise": "| [Noise](#noise) | odd |"})
    before, after = TEXT.splitlines(), new.splitlines()
    assert len(before) == len(after)
    changed = [line for old, line in zip(before, after, strict=True) if old != line]
    assert changed == ["| [Noise](#noise) | odd |", *(f"> {line}" for line in quotations["noise"])]


@pytest.mark.parametrize("missing", ["## Noise\n", "| [Noise](#noise)"])
def test_a_page_without_a_place_for_the_words_is_refused(missing: str) -> None:
    with pytest.raises(ValueError, match=r"read-frf\.md has 0 places"):
        GALLERY.written(TEXT.replace(missing, ""), {"noise": ["x"]}, {"noise": "y"})
