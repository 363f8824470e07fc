from __future__ import annotations

import re

import pytest

from ballscrew.fcft.dialect import DIALECTS, find_dialect, plain_ascii


@pytest.mark.parametrize(
    ("seconds", "milliseconds"), [(0.0, 1), (0.35, 350), (2.0004, 2000), (3600.0, 3_600_000)]
)
def test_a_dwell_in_each_dialect(seconds, milliseconds):
    text = f"{milliseconds / 1000:.3f}"
    assert [dialect.dwells(seconds) for dialect in DIALECTS] == [
        f"G4 P{text}", f"G04 P{milliseconds}", f"G4 F{text}"
    ]  # fmt: skip


@pytest.mark.parametrize("length", range(40, 80))
def test_a_broken_line_never_begins_with_what_a_controller_obeys(length):
    lines = list(find_dialect("iso").remarks(f"axis: {'y' * length} LOGOPEN,/tmp/x MSG, y"))
    assert all(re.fullmatch(r"\((?:axis:|\.\.\. )[^()]*\)", line) and len(line) <= 80 for line in lines)


def test_what_a_text_becomes():
    assert plain_ascii("Größe 5 m/s² (x) \t\n;%") == "Gro_e 5 m/s2 _x_ ____"
    assert list(find_dialect("siemens").remarks("a;b")) == ["; a_b"]
    assert list(find_dialect("fanuc").remarks("trip 1")) == ["(TRIP 1)"]


@pytest.mark.parametrize("before", range(55, 76))
def test_a_number_and_its_unit_stay_on_one_line(before):
    text = "x" * before + " jerk 2402.3 m/s3 and 0.35 s"
    lines = list(find_dialect("iso").remarks(text))
    assert any("2402.3 m/s3" in line for line in lines)
    assert any("0.35 s" in line for line in lines)
    assert "~" not in "".join(lines)
