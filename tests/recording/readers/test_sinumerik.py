from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.process import opened
from ballscrew.recording.readers.sinumerik import ResponseReader, TraceReader

DIGITS = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ!#$`()*+-/:;=?@[]^_{|}~"
CURRENT, POSITION, LOAD = "/Nck/!SD/ActCurr64 [u1, 1]", "/Nck/!SD/ActPos1stEnc64 [u1, 1]", "/Nck/!SD/Load"


def signal(number: int, name: str, unit: str, interval: str = "0.002000") -> str:
    return (
        f'<dataSignal key="s{number}" id="f{number}" name="{name}" unitsType="{unit}" interval="{interval}"/>'
    )


def trace(records: list[str], drop_outs: int = 0, signals: str | None = None, frames: int = 1) -> str:
    listed = signals or "".join(
        [signal(1, CURRENT, "current"), signal(2, POSITION, "posn", "0.004000"), signal(3, LOAD, "611DTime1")]
    )
    header = f'<frameHeader dropOuts="{drop_outs}" startTime="2019-06-03T17:57:40.613Z"/>'
    rows = "\n".join(f"<rec {record}/>" for record in records)
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<traceSession version="01.00.03.02"><traceCaptureSetup>'
        '<signalSettings><signal key="s3" unitsType="torque"/></signalSettings></traceCaptureSetup>'
        f"<traceData>{f'<dataFrame>{header}{listed}{rows}</dataFrame>' * frames}</traceData></traceSession>"
    )


RECORDS = [
    'time="0.000000" f1="1.5" f3="7"',
    'time="0.002000" f1="-2" f2="100.25"',
    'time="0.008000" f1="3"',
    'time="0.010000" f2="101"',
    'time="0.012000" f1="4"',
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "trace.xml"


def test_an_omitted_value_is_the_one_before_also_where_records_are_absent(path: Path) -> None:
    path.write_text(trace(RECORDS))
    assert reader_for(path).name == "sinumerik-trace"
    with opened(path) as file:
        header, values = file.header, file.read([CURRENT, POSITION, LOAD])
    assert [(c.name, c.unit, c.sample_rate, c.start, c.size) for c in header.channels] == [
        (CURRENT, "A", 500.0, 0.0, 7),
        (POSITION, "mm", 250.0, 0.002, 3),
        (LOAD, "N m", 500.0, 0.0, 7),
    ]
    assert header.started_at == "2019-06-03T17:57:40.613Z"
    np.testing.assert_array_equal(values[CURRENT], [1.5, -2, -2, -2, 3, 3, 4])
    np.testing.assert_array_equal(values[POSITION], [100.25, 100.25, 101])
    np.testing.assert_array_equal(values[LOAD], [7.0] * 7)


def test_records_that_the_control_lost_are_nan(path: Path) -> None:
    path.write_text(trace(RECORDS, drop_outs=2))
    values = TraceReader().read(path, [CURRENT])[CURRENT]
    np.testing.assert_array_equal(values, [1.5, -2, np.nan, np.nan, 3, 3, 4])


def test_a_signal_without_a_value_is_not_listed(path: Path) -> None:
    path.write_text(trace(['time="0" f1="1"', 'time="0.002" f1="2"']))
    assert [channel.name for channel in TraceReader().read_header(path).channels] == [CURRENT]
    with pytest.raises(InputError, match="has no channel"):
        TraceReader().read(path, [LOAD])


def test_signals_of_one_name_are_numbered(path: Path) -> None:
    path.write_text(trace(['time="0" f1="1" f2="2"'], signals=signal(1, "a", "") + signal(2, "a", "velo")))
    channels = TraceReader().read_header(path).channels
    assert [(channel.name, channel.unit) for channel in channels] == [("a", None), ("a_2", "mm/min")]


ENTITIES = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">]>\n<traceSession>&a;</traceSession>'


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (ENTITIES, "declares a document type"),
        (trace(RECORDS)[:-40], "is damaged or cut off"),
        (trace([]), "holds no recorded signal"),
        (trace(RECORDS, frames=2), "has several recordings"),
        (trace(['time="0" f1="1_0"']), "values that are no numbers"),
        (trace(['time="0" f1=""']), "values that are no numbers"),
        (trace(['time="0" f1="nan"']), "values that are no numbers"),
        (trace(['f1="1"']), "cannot be read as SINUMERIK trace"),
        (trace(['time="0" f1="1"', 'time="0.003" f1="1"']), "no multiple of its interval of 0.002 s"),
        (trace(['time="0" f1="1"', 'time="-0.002" f1="1"']), "do not increase"),
        (trace(['time="0" f1="1"', 'time="1e200" f1="1"']), "its times are damaged"),
        (trace(['time="0" f1="1"', 'time="1e8" f1="1"']), "more than a file of this size can hold"),
        (trace(RECORDS, signals=signal(1, "a", "", "0")), "must be more than 0"),
        (trace(RECORDS, signals=signal(1, "a", "") * 2), "two signals have the id 'f1'"),
        (trace(RECORDS, signals=signal(1, "a", "").replace("interval", "x")), "no interval"),
    ],
)
def test_a_damaged_trace_is_one_sentence(path: Path, text: str, reason: str) -> None:
    path.write_text(text)
    with pytest.raises(InputError, match=reason):
        TraceReader().read_header(path)


def test_signals_of_one_name_are_read_within_the_processor_time_of_their_size(path: Path) -> None:
    count = 20_000
    signals = "".join(signal(number, "a", "") for number in range(count))
    record = " ".join(f'f{number}="1"' for number in range(count))
    path.write_text(trace([f'time="0" {record}'], signals=signals))
    with opened(path) as file:
        assert file.header.channels[-1].name == f"a_{count}"


def encoded(values: np.ndarray) -> str:
    """Base 85 of the control, with a point for each word 0."""
    text = ""
    for (word,) in struct.iter_unpack(">I", np.asarray(values, ">f8").tobytes()):
        digits = [DIGITS[word // 85**power % 85] for power in range(4, -1, -1)]
        text += "".join(digits) if word else "."
    return text


def time_series(values: np.ndarray, length: int | None = None, text: str | None = None) -> str:
    size = len(values) if length is None else length
    raw = encoded(values) if text is None else text
    end = (size - 1) * 0.000125
    return (
        f'<TimeSeries satclassid="18"><NumericArray><unsigned_int name="m_length">{size}</unsigned_int>'
        f'<raw name="m_pNumberArray"><![CDATA[\n {raw[:25]}\n {raw[25:]}]]></raw></NumericArray>'
        f'<float name="m_TimeVector.start">0</float><float name="m_TimeVector.end">{end!r}</float>'
        f'<unsigned_int name="m_TimeVector.length">{size}</unsigned_int></TimeSeries>'
    )


def response(*series: str) -> str:
    stamp = '<unsigned_int name="Date">20221123</unsigned_int><float name="Time">103136.6</float>'
    listed = '<unsigned_int name="m_uNodeId">61</unsigned_int>' + "".join(series)
    content = f"<SatTimeStamp>{stamp}</SatTimeStamp>{listed}"
    return f'<?xml version="1.0" encoding="ISO-8859-1"?><Test satclassid="174">{content}</Test>'


VALUES = np.array([0.0, 1.5, -2.25, 1e-300, np.pi, 0.0])


def test_time_series_of_a_response(path: Path) -> None:
    path.write_text(response(time_series(VALUES), time_series(-VALUES)))
    assert reader_for(path).name == "sinumerik-response"
    header = ResponseReader().read_header(path)
    assert [(c.name, c.size, c.unit) for c in header.channels] == [
        ("signal 61, series 1", 6, None),
        ("signal 61, series 2", 6, None),
    ]
    assert header.channels[0].sample_rate == pytest.approx(8000.0)
    assert header.started_at == "2022-11-23T10:31:36.6"
    values = ResponseReader().read(path, ["signal 61, series 2"])
    np.testing.assert_array_equal(values["signal 61, series 2"], -VALUES)


@pytest.mark.parametrize(
    ("series", "reason"),
    [
        ("", "has no time series"),
        (time_series(VALUES, text="kH)"), "no sequence of words"),
        (time_series(VALUES, text='"' * 60), "letters that are no digits"),
        (time_series(VALUES, text="~" * 60), "a word of it is too large"),
        (time_series(VALUES, length=10**15), "not as many as it declares"),
        (time_series(VALUES)[:-60] + "</TimeSeries>", "is damaged or cut off|has no m_Time"),
        (time_series(VALUES).replace('start">0', 'start">9'), "must be more than 0"),
    ],
)
def test_a_damaged_response_is_one_sentence(path: Path, series: str, reason: str) -> None:
    path.write_text(response(series))
    with pytest.raises(InputError, match=reason):
        ResponseReader().read_header(path)


@pytest.mark.parametrize("text", [trace(RECORDS), response(time_series(VALUES))])
def test_a_changed_byte_is_a_recording_or_one_sentence(
    path: Path, text: str, survives: Callable[[Path], bool]
) -> None:
    raw = text.encode()
    generator = np.random.default_rng(0)
    for position, byte in zip(
        generator.integers(0, len(raw), 300), generator.integers(0, 256, 300), strict=True
    ):
        path.write_bytes(raw[:position] + bytes([byte]) + raw[position + 1 :])
        survives(path)


def test_the_response_of_a_real_axis(data: Path) -> None:
    """8 kHz, two directions; the excitation is binary, 0.2094 around 0.4189 rad/s, as the file declares."""
    path = data / "machine-files" / "sinumerik-freq-trace.xml"
    header = ResponseReader().read_header(path)
    assert [channel.name for channel in header.channels] == [
        f"signal {node}, series {number}" for node in (61, 62) for number in (1, 2)
    ]
    assert {channel.size for channel in header.channels} == {2047}
    assert header.channels[0].sample_rate == pytest.approx(8000.0)
    excitation = ResponseReader().read(path, ["signal 62, series 1"])["signal 62, series 1"]
    assert np.ptp(excitation) / 2 == pytest.approx(0.20944, rel=1e-3)
    assert excitation.mean() == pytest.approx(0.41888, rel=1e-3)
