# SPDX-License-Identifier: Apache-2.0
"""A recording is read as data: what it asks to be run is refused, and what is broken is said in one line."""

import io
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mild_core.errors import DatasetError
from mild_core.learning.data.safe_npz import read_safe_npz


class Call:
    """Pickles as a call of `function(*arguments)`."""

    def __init__(self, function, *arguments):
        self.call = (function, arguments)

    def __reduce__(self):
        return self.call


def object_array(*values):
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array


def npy_of_pickle(payload: bytes, shape=(1,)) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "|O", "fortran_order": False, "shape": shape})
    return stream.getvalue() + payload


def npz(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return path


@pytest.mark.parametrize("protocol", [3, 4])  # what numpy 1 and numpy 2 write
def test_object_arrays_of_numbers_come_back_as_they_were(tmp_path, protocol):
    rng = np.random.default_rng(0)
    arrays = [rng.normal(size=(5, 3)), np.asfortranarray(rng.normal(size=(4, 2))), np.arange(6, dtype=">i4"), np.eye(0)]
    payload = pickle.dumps(object_array(*arrays), protocol)
    read = read_safe_npz(npz(tmp_path / "a.npz", tracks=npy_of_pickle(payload, (4,))), ["tracks"])["tracks"]
    assert len(read) == 4
    for got, wanted in zip(read, arrays, strict=True):
        np.testing.assert_array_equal(got, wanted)
        assert got.shape == wanted.shape


def test_numpys_own_files_are_read(tmp_path):
    path = tmp_path / "a.npz"
    ragged = object_array(np.zeros((3, 2)), np.ones((5, 2)))
    np.savez_compressed(path, ragged=ragged, plain=np.arange(3.0), names=np.array(["a", "bc"]), empty=object_array())
    read = read_safe_npz(path, ["ragged", "plain", "names", "empty"])
    assert [part.shape for part in read["ragged"]] == [(3, 2), (5, 2)]
    assert read["plain"].tolist() == [0, 1, 2]
    assert read["names"].tolist() == ["a", "bc"]
    assert len(read["empty"]) == 0


@pytest.mark.parametrize("protocol", [2, 4])
@pytest.mark.parametrize("where", ["instead of the array", "inside the array"])
def test_a_hostile_pickle_is_refused_and_nothing_of_it_runs(tmp_path, protocol, where):
    witness = tmp_path / "executed"
    attack = Call(Path.touch, witness)
    payload = pickle.dumps(attack if where == "instead of the array" else object_array(np.zeros(2), attack), protocol)
    # The canary: the same bytes do run under plain pickle, so the refusal below is what stops them.
    pickle.loads(payload)
    assert witness.exists()
    witness.unlink()
    path = npz(tmp_path / "hostile.npz", tracks=npy_of_pickle(payload))
    with pytest.raises(DatasetError, match="nothing of it was run") as refused:
        read_safe_npz(path, ["tracks"])
    assert not witness.exists()
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "call",
    [
        Call(eval, "1"),
        Call(getattr, np.ndarray, "tofile"),
        Call(np.load, "x"),
        Call(np.frombuffer, b"12345678"),
        Call(bytearray, 1 << 40),
    ],
)
def test_no_other_function_is_admitted(tmp_path, call):
    path = npz(tmp_path / "a.npz", tracks=npy_of_pickle(pickle.dumps(call)))
    with pytest.raises(DatasetError, match="not needed to store numbers"):
        read_safe_npz(path, ["tracks"])


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (np.zeros(2, dtype=[("a", "f8")]), "an array of"),
        (np.zeros(2, dtype="V8"), "an array of type"),
        (np.zeros(2, dtype="M8[s]"), "an array of"),
        ({"a": 1}, "object of type dict"),
        (object_array(object_array(object_array(np.zeros(1)))), "nested too deeply"),
    ],
)
def test_only_numbers_and_text_are_admitted(tmp_path, value, said):
    path = npz(tmp_path / "a.npz", tracks=npy_of_pickle(pickle.dumps(object_array(value))))
    with pytest.raises(DatasetError, match=said):
        read_safe_npz(path, ["tracks"])


def test_a_claimed_shape_larger_than_the_content_is_refused(tmp_path):
    payload = pickle.dumps(object_array(np.zeros((3, 2))), 3).replace(b"K\x03K\x02\x86", b"J\xff\xff\xff\x7fK\x02\x86")
    with pytest.raises(DatasetError, match="broken array"):
        read_safe_npz(npz(tmp_path / "a.npz", tracks=npy_of_pickle(payload)), ["tracks"])


def test_a_huge_memo_index_costs_nothing(tmp_path):
    payload = b"\x80\x02]r\xff\xff\xff\x7f."  # an empty list, remembered under number 2^31 - 1
    with pytest.raises(DatasetError, match="no array"):
        read_safe_npz(npz(tmp_path / "a.npz", tracks=npy_of_pickle(payload)), ["tracks"])


def test_a_zip_bomb_is_refused_unread(tmp_path, monkeypatch):
    monkeypatch.setattr("mild_core.learning.data.safe_npz.LARGEST_BYTES", 1000)
    np.savez_compressed(tmp_path / "a.npz", tracks=np.zeros(1000))
    with pytest.raises(DatasetError, match=r"unpacks to .*, more than 1 kB"):
        read_safe_npz(tmp_path / "a.npz", ["tracks"])


def test_an_absent_file_and_an_absent_array_are_named(tmp_path):
    with pytest.raises(DatasetError, match="no such file"):
        read_safe_npz(tmp_path / "none.npz", ["tracks"])
    np.savez(tmp_path / "a.npz", other=np.zeros(1))
    with pytest.raises(DatasetError, match=r"no array 'tracks' \(only other\)"):
        read_safe_npz(tmp_path / "a.npz", ["tracks"])


def test_every_truncation_is_one_clear_line(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", tracks=object_array(np.arange(300.0).reshape(100, 3)))
    whole = (tmp_path / "a.npz").read_bytes()
    for length in range(0, len(whole) - 1, 7):
        (tmp_path / "cut.npz").write_bytes(whole[:length])
        with pytest.raises(DatasetError) as refused:
            read_safe_npz(tmp_path / "cut.npz", ["tracks"])
        assert "\n" not in str(refused.value)


def test_every_truncated_pickle_is_one_clear_line(tmp_path):
    payload = pickle.dumps(object_array(np.arange(12.0).reshape(4, 3)))
    for length in range(len(payload)):
        path = npz(tmp_path / "cut.npz", tracks=npy_of_pickle(payload[:length]))
        with pytest.raises(DatasetError) as refused:
            read_safe_npz(path, ["tracks"])
        assert "\n" not in str(refused.value)


def test_an_absent_array_is_reported_once(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", train_data=np.zeros(2))
    with pytest.raises(DatasetError) as error:
        read_safe_npz(tmp_path / "a.npz", ("train_data", "test_data"))
    assert "has no array 'test_data' (only train_data)" in str(error.value)
    assert "broken" not in str(error.value)
