"""Whatever the bytes are: a recording or one sentence, never anything else."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
import scipy.io.wavfile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.recording.readers.machine_files import Mdf, function, measurement, tdms

X = np.linspace(0.0, 1.0, 300)


def make_h5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["sample_rate"] = 1000.0
        file["torque"] = X
        file.create_dataset("group/position", data=X, compression="gzip", shuffle=True)


def make_mat(path: Path) -> None:
    scipy.io.savemat(path, {"torque": X, "s": {"position": X}, "fs": 1000.0})


def make_mat_packed(path: Path) -> None:
    scipy.io.savemat(path, {"torque": X, "s": {"position": X}, "fs": 1000.0}, do_compression=True)


def make_npz(path: Path) -> None:
    np.savez_compressed(path, torque=X, position=X, fs=1000.0)


def make_parquet(path: Path) -> None:
    pd.DataFrame({"torque": X, "position": X}).to_parquet(path)


def make_csv(path: Path) -> None:
    pd.DataFrame({"torque": X, "position": X}).to_csv(path)


def make_wav(path: Path) -> None:
    scipy.io.wavfile.write(path, 1000, np.stack([X, X], axis=1).astype(np.float32))


def make_uff(path: Path) -> None:
    path.write_bytes(
        function(X) + function(X, "    58b     1     2          11        2400     0     0     0     0")
    )


def make_tdms(path: Path) -> None:
    path.write_bytes(tdms({"torque": X, "position": X}, properties={"wf_increment": 0.001}))


def make_lvm(path: Path) -> None:
    path.write_bytes(measurement([X, X]))


def make_mdf(path: Path) -> None:
    file = Mdf()
    channels = file.channel("torque", 8, unit="N m", flags=2)
    channels = file.channel("t", 0, channels, kind=2, sync=1, unit="s")
    rows = np.rec.fromarrays([X, X, X < 0], dtype=[("t", "<f8"), ("torque", "<f8"), ("invalid", "u1")])
    data = file.listed(file.packed(rows[:100].tobytes()), file.packed(rows[100:].tobytes(), rows.itemsize))
    file.group(channels, data, X.size, 16, invalidation=1)
    path.write_bytes(file.to_bytes())


MAKERS = {
    "a.h5": make_h5,
    "a.mat": make_mat,
    "packed.mat": make_mat_packed,
    "a.npz": make_npz,
    "a.parquet": make_parquet,
    "a.csv": make_csv,
    "a.wav": make_wav,
    "a.uff": make_uff,
    "a.lvm": make_lvm,
    "a.tdms": make_tdms,
    "a.mf4": make_mdf,
}
for extra, library in (("a.tdms", "nptdms"), ("a.mf4", "asammdf")):
    if find_spec(library) is None:
        del MAKERS[extra]


@pytest.fixture(params=sorted(MAKERS))
def good(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / request.param
    MAKERS[request.param](path)
    return path


def test_the_whole_file_is_read(good: Path, survives: Callable[[Path], bool]) -> None:
    assert survives(good)


def test_a_file_cut_anywhere(good: Path, survives: Callable[[Path], bool]) -> None:
    whole = good.read_bytes()
    cut = good.with_stem("cut")
    read = 0
    # The last line of LVM and UFF is empty or a mark, without which the values are complete.
    end = len(whole) - (8 if good.suffix in (".lvm", ".uff") else 1)
    for part in np.linspace(0, end, 60).astype(int):
        cut.write_bytes(whole[:part])
        read += survives(cut)
    # A text cut at the end of a line is a shorter text, and a MAT file a series of variables.
    assert read == 0 or good.suffix in (".csv", ".mat")


@pytest.mark.parametrize("seed", range(3))
def test_changed_bytes(good: Path, survives: Callable[[Path], bool], seed: int) -> None:
    rng = np.random.default_rng(seed)
    whole = np.frombuffer(good.read_bytes(), np.uint8)
    bad = good.with_stem("bad")
    for _ in range(40):
        changed = whole.copy()
        at = rng.integers(0, min(len(changed), 4000), 4)
        changed[at] = rng.integers(0, 256, 4)
        bad.write_bytes(changed.tobytes())
        survives(bad)


HEADS = [
    b"\x89HDF\r\n\x1a\n",
    b"MATLAB 5.0 MAT-file" + b" " * 105 + b"\x00\x01IM",
    b"MATLAB 7.3 MAT-file" + b" " * 493 + b"\x89HDF\r\n\x1a\n",
    b"PAR1",
    b"PK\x03\x04",
    b"PK\x05\x06",
    b"RIFF\x00\x01\x00\x00WAVEfmt \x10\x00\x00\x00",
    b"    -1\n    58\n",
    b"LabVIEW Measurement\t\n",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"",
]


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    head=st.sampled_from(HEADS), tail=st.binary(max_size=2000), name=st.sampled_from(["a.npz", "a.mat", "a"])
)
def test_random_bytes_with_the_right_beginning(
    head: bytes, tail: bytes, name: str, tmp_path: Path, survives: Callable[[Path], bool]
) -> None:
    path = tmp_path / name
    path.write_bytes(head + tail)
    survives(path)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=st.text(alphabet='0123456789.,;\t\n\r +-eEnaN"#%[]/m', max_size=300))
def test_random_text(text: str, tmp_path: Path, survives: Callable[[Path], bool]) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode())
    survives(path)
