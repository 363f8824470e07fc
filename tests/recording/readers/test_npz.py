from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.npz import NpzReader

X = np.arange(40.0)
READER = NpzReader()


class Bomb:
    def __reduce__(self) -> tuple[object, ...]:
        return (pytest.fail, ("a pickle was run",))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.npz"


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_channels(path: Path, save: object) -> None:
    save(
        path,
        torque=X.astype(np.float32),
        position=X.astype(">i4")[:, None],
        fs=1000,
        picture=np.zeros((4, 5)),
    )  # type: ignore[operator]
    assert reader_for(path).name == "npz"
    header = READER.read_header(path)
    assert [(c.name, c.size) for c in header.channels] == [("torque", 40), ("position", 40)]
    assert header.sample_rate == 1000.0
    values = READER.read(path, ["torque", "position"])
    assert values["torque"].dtype == np.float32
    np.testing.assert_array_equal(values["position"], X)
    with pytest.raises(InputError, match="has no channel 'absent'"):
        READER.read(path, ["absent"])
    with pytest.raises(InputError, match="of shape"):
        READER.read(path, ["picture"])


def test_pickles_are_refused_and_not_run(path: Path) -> None:
    np.savez(path, torque=np.array([Bomb()] * 3, dtype=object))
    with pytest.raises(InputError, match="'torque' is pickled Python objects"):
        READER.read_header(path)
    with pytest.raises(InputError, match="'torque' is pickled Python objects"):
        READER.read(path, ["torque"])


def test_a_pickle_beside_good_channels_is_ignored(path: Path) -> None:
    np.savez(path, torque=X, notes=np.array([Bomb()], dtype=object))
    assert [channel.name for channel in READER.read_header(path).channels] == ["torque"]
    np.testing.assert_array_equal(READER.read(path, ["torque"])["torque"], X)


@pytest.mark.parametrize(
    ("shape", "message"), [((10**12,), "declares 8000000000000 bytes"), ((4000,), "is cut or forged")]
)
def test_a_size_that_is_not_there(path: Path, shape: tuple[int, ...], message: str) -> None:
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("torque.npy", member.getvalue() + bytes(320))
    with pytest.raises(InputError, match=message):
        READER.read(path, ["torque"])


def test_members_that_are_no_arrays(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", b"not an array")
    with pytest.raises(InputError, match="cannot be read as NPZ"):
        READER.read_header(path)


@pytest.mark.parametrize(("version", "names"), [((1, 0), ["a"]), ((2, 0), ["a"]), ((3, 0), [])])
def test_each_version_of_the_format_is_read_and_records_are_no_channels(
    path: Path, version: tuple[int, int], names: list[str]
) -> None:
    values = X
    if version == (3, 0):
        values = np.zeros(40, dtype=[("\u03c4", "f8")])
    member = io.BytesIO()
    np.lib.format.write_array(member, values, version=version)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", member.getvalue())
    np.savez(path.with_name("b.npz"), b=X)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("b.npy", zipfile.ZipFile(path.with_name("b.npz")).read("b.npy"))
    assert [channel.name for channel in READER.read_header(path).channels] == [*names, "b"]
    for name in names:
        np.testing.assert_array_equal(READER.read(path, [name])[name], X)


def test_a_shape_that_no_array_has_is_refused(path: Path) -> None:
    member = io.BytesIO()
    np.lib.format.write_array_header_1_0(member, {"descr": "<f8", "fortran_order": False, "shape": (-40,)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("torque.npy", member.getvalue() + X.tobytes())
    with pytest.raises(InputError, match=r"'torque' declares the impossible shape \(-40,\)"):
        READER.read_header(path)
