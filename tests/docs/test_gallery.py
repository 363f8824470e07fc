"""The gallery shows what the testbed makes, and quotes what the software says of it."""

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
    kept = sorted((DOCS / "_static").glob("gallery-*.png"))
    assert {path.stem.removeprefix("gallery-") for path in kept} == set(ENTRIES)
    for path in kept:
        width, height = struct.unpack(">II", path.read_bytes()[16:24])
        assert (width, height) == (900, 750), path.name


@pytest.mark.parametrize("name", list(ENTRIES))
def test_each_entry_is_told_in_four_parts(name: str) -> None:
    text = section(TEXT, ENTRIES[name].title)
    assert re.findall(r"^\*\*([^*]+)\*\*", text, re.M) == list(LEADS)
    assert re.search(r"^:alt: .{20,}$", text, re.M)
    said = re.findall(r"^> \*\*([^*:]+): (\w+)\*\*", text, re.M)
    entry = ENTRIES[name]
    cell = f"Cell at {1e3 * entry.position:g} mm, {entry.condition}"
    assert [what for what, _ in said] == ["Measurement", cell]
    assert said[0][1] == row_of(name).split("|")[2].strip()


@pytest.mark.parametrize("name", MADE)
def test_the_words_and_numbers_are_those_that_the_software_says(name: str, runs: dict[str, Run]) -> None:
    entry = ENTRIES[name]
    shown = re.findall(r"^>.*$", section(TEXT, entry.title), re.M)
    same(GALLERY.quoted(GALLERY.said(entry, runs[name])), "\n".join(shown))
    same(GALLERY.row(entry, runs[name]), row_of(name))


def test_the_picture_tells_the_verdict_and_the_truth(runs: dict[str, Run]) -> None:
    entry = ENTRIES["late"]
    upper, phase, _ = GALLERY.draw(entry, runs["late"], runs["good"]).axes
    cell = GALLERY.cell_of(runs["late"], entry.position, entry.condition)
    assert (upper.get_title("left"), upper.get_title("right")) == (entry.title, cell.verdict)
    assert f"true {entry.true:.1f} Hz" in upper.get_legend_handles_labels()[1]
    grey, *own = (float(line.get_ydata()[-1]) for line in phase.lines[:3])
    # 2 ms at the right edge are 230°, less the whole turn.
    assert all(abs((x - grey - 2e-3 * 360 * GALLERY.SHOWN[1] + 180) % 360 - 180) < 5 for x in own)


def test_words_take_the_place_of_words_and_nothing_else_changes() -> None:
    told = {"noise": ["**Measurement: odd**.", "**Cell: odd**."]}
    new = GALLERY.written(TEXT, told, {"noise": "| [Noise](#noise) | odd |"})
    before, after = TEXT.splitlines(), new.splitlines()
    assert len(before) == len(after)
    changed = [other for one, other in zip(before, after, strict=True) if one != other]
    assert changed == ["| [Noise](#noise) | odd |", *(f"> {line}" for line in told["noise"])]


@pytest.mark.parametrize("missing", ["## Noise\n", "| [Noise](#noise)"])
def test_a_page_without_a_place_for_the_words_is_refused(missing: str) -> None:
    with pytest.raises(ValueError, match=r"read-frf\.md has 0 places"):
        GALLERY.written(TEXT.replace(missing, ""), {"noise": ["x"]}, {"noise": "y"})
