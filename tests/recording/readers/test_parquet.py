from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import parquet, reader_for
from ballscrew.recording.readers.parquet import ParquetReader

X = np.arange(40.0)
READER = ParquetReader()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.parquet"


def test_without_pyarrow_the_extra_is_named(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path.write_bytes(b"PAR1")
    monkeypatch.setattr(parquet, "pa", None)
    with pytest.raises(
        InputError, match=r"a\.parquet: Parquet needs pyarrow.*install ballscrew\[parquet\]\.$"
    ):
        reader_for(path).read_header(path)


def test_channels_units_and_rate(path: Path) -> None:
    schema = pa.schema(
        [
            pa.field("torque", pa.float32(), metadata={"unit": "N m"}),
            pa.field("position", pa.int32()),
            pa.field("exact", pa.decimal128(6, 2)),
            pa.field("state", pa.string()),
        ],
        metadata={"sample_rate": "12.8 kHz", "started_at": "2026-01-31"},
    )
    position = [None, *range(1, 40)]
    columns = [X.astype(np.float32), position, [Decimal("1.25")] * 40, ["RUN"] * 40]
    pq.write_table(pa.table(dict(zip(schema.names, columns, strict=True)), schema=schema), path)
    assert reader_for(path).name == "parquet"
    header = READER.read_header(path)
    assert [(c.name, c.size, c.unit) for c in header.channels] == [
        ("torque", 40, "N m"),
        ("position", 40, None),
        ("exact", 40, None),
    ]
    assert (header.sample_rate, header.started_at) == (12800.0, "2026-01-31")
    values = READER.read(path, ["torque", "position", "exact"])
    assert values["torque"].dtype == np.float32
    assert values["position"].dtype == np.float64
    assert np.isnan(values["position"][0])
    np.testing.assert_array_equal(values["position"][1:], X[1:])
    assert values["exact"][0] == 1.25
    with pytest.raises(InputError, match="holds string"):
        READER.read(path, ["state"])
    with pytest.raises(InputError, match="has no channel"):
        READER.read(path, ["absent"])


def test_moments_and_attributes_of_pandas(path: Path) -> None:
    frame = pd.DataFrame({"stamp": pd.date_range("2026-01-31", periods=40, freq="1ms"), "torque": X})
    frame.attrs["sample_rate"] = 1000
    frame.to_parquet(path)
    header = READER.read_header(path)
    assert header.sample_rate == 1000.0
    assert header.channels[0].unit == "s"
    np.testing.assert_allclose(READER.read(path, ["stamp"])["stamp"], X * 1e-3, rtol=0, atol=1e-12)


@pytest.mark.parametrize("text", ["{", "[" * 100_000, "[1]", "3"])
def test_attributes_that_are_no_object_are_none(path: Path, text: str) -> None:
    schema = pa.schema([pa.field("torque", pa.float64())], metadata={"PANDAS_ATTRS": text})
    pq.write_table(pa.table({"torque": X}, schema=schema), path)
    header = READER.read_header(path)
    assert (header.sample_rate, [channel.name for channel in header.channels]) == (None, ["torque"])
