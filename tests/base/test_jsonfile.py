from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain, read_json, write_json


def test_what_was_written_can_be_read(tmp_path):
    document = {"schema": 2, "cells": [{"frequency_Hz": None, "verdict": "refused"}], "name": "Kohärenz µ"}
    (tmp_path / "run.json").write_text(write_json(document), encoding="utf-8")
    assert read_json(tmp_path / "run.json") == document


def test_the_text_is_ascii():
    assert write_json({"schema": 2, "x": "µ"}).isascii()


@pytest.mark.parametrize(
    ("value", "becomes"),
    [
        (math.nan, None),
        (math.inf, None),
        (np.float64("nan"), None),
        (np.float32(0.5), 0.5),
        (np.int64(3), 3),
        (np.bool_(True), True),
        (np.array([1.0, np.nan]), [1.0, None]),
        ((1, 2), [1, 2]),
        ({1: "a"}, {"1": "a"}),
        (0.1 + 0.2, 0.3),
        (True, True),
        (10**30, 10**30),
    ],
)
def test_plain(value, becomes):
    assert plain(value) == becomes
    assert type(plain(value)) is type(becomes)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_nine_digits_are_kept(value):
    assert plain(value) == pytest.approx(value, rel=1e-8, abs=1e-300)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "not json",
        '{"schema": NaN}',
        '{"schema": 2, "a": Infinity}',
        "[" * 100_000,
        "\x00",
        '{"schema": 2',
    ],
)
def test_what_is_not_json(tmp_path, text):
    (tmp_path / "run.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"run\.json: is not JSON"):
        read_json(tmp_path / "run.json")


def test_bytes_that_are_no_text(tmp_path):
    (tmp_path / "run.json").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputError, match="is not JSON"):
        read_json(tmp_path / "run.json")


def test_no_file(tmp_path):
    with pytest.raises(InputError, match=r"none\.json: cannot be read"):
        read_json(tmp_path / "none.json")


@pytest.mark.parametrize(
    "document", [[], 3, None, "text", {}, {"schema": True}, {"schema": "1"}, {"schema": 0}, {"schema": 1.5}]
)
def test_what_is_no_result(tmp_path, document):
    (tmp_path / "run.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match="schema"):
        read_json(tmp_path / "run.json")


def test_a_later_schema_is_refused(tmp_path):
    (tmp_path / "run.json").write_text(json.dumps({"schema": SCHEMA + 1}), encoding="utf-8")
    with pytest.raises(InputError, match="was written by a later version"):
        read_json(tmp_path / "run.json")


def test_the_unreleased_schema_is_refused_in_one_sentence(tmp_path):
    (tmp_path / "run.json").write_text('{"schema": 1}', encoding="utf-8")
    with pytest.raises(InputError, match=r"before the first release.*make it again"):
        read_json(tmp_path / "run.json")


def test_a_byte_order_mark_is_not_in_the_way(tmp_path):
    (tmp_path / "run.json").write_text('{"schema": 2}', encoding="utf-8-sig")
    assert read_json(tmp_path / "run.json") == {"schema": 2}
