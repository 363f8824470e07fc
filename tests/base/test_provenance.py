from __future__ import annotations

import hashlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew._version import __version__
from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef, Made, digest, hash_file


def test_the_hash_of_a_file_is_that_of_its_content(tmp_path):
    content = bytes(range(256)) * 10_000
    (tmp_path / "a.bin").write_bytes(content)
    assert hash_file(tmp_path / "a.bin") == hashlib.sha256(content).hexdigest()


def test_an_empty_file_has_a_hash_too(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"")
    assert hash_file(tmp_path / "a.bin") == hashlib.sha256(b"").hexdigest()


@pytest.mark.parametrize("name", ["none.bin", "."])
def test_a_file_that_cannot_be_read(tmp_path, name):
    with pytest.raises(InputError, match="cannot be read"):
        hash_file(tmp_path / name)


def test_the_order_of_keys_does_not_matter():
    assert digest({"a": 1, "b": [1, 2]}) == digest({"b": [1, 2], "a": 1})


def test_content_matters():
    documents = [{}, {"a": 1}, {"a": 2}, {"a": "1"}, {"a": None}, [1, 2], [2, 1], ["ä"]]
    assert len({digest(document) for document in documents}) == len(documents)


def test_a_nan_has_no_digest():
    with pytest.raises(ValueError, match="JSON compliant"):
        digest({"a": math.nan})


@given(
    st.dictionaries(st.text(), st.integers() | st.text() | st.floats(allow_nan=False, allow_infinity=False))
)
def test_a_digest_is_one_and_the_same(document):
    assert digest(document) == digest(dict(reversed(document.items())))
    assert len(digest(document)) == 64


def test_a_result_knows_the_version_that_made_it():
    assert Made({"window": 0.15}).version == __version__


def test_file_references_compare_by_value():
    assert FileRef("a", "0") == FileRef("a", "0") != FileRef("a", "1")
