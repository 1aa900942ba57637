import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.recording.log import read_log, write_log

names = st.text("abcz./_ ", min_size=1, max_size=8).filter(
    lambda name: name.strip("./ ") == name
)
arrays = st.lists(st.floats(width=32), max_size=6).map(np.array)


@pytest.mark.slow
@given(log=st.dictionaries(names, arrays, max_size=4))
def test_a_log_is_read_as_it_was_written(tmp_path_factory, log):
    path = write_log(tmp_path_factory.mktemp("log") / "log.npz", log)
    read = read_log(path)
    assert set(read) == set(log)
    for name, array in log.items():
        np.testing.assert_array_equal(read[name], array)


def test_equal_arrays_give_equal_bytes_at_any_date(tmp_path, monkeypatch):
    one = {"time": np.arange(100.0), "file": np.array(["a", "b"])}
    first = write_log(tmp_path / "a.npz", one).read_bytes()
    monkeypatch.setattr("time.localtime", lambda *_: (2031, 2, 3, 4, 5, 6, 0, 1, 0))
    monkeypatch.setattr("time.time", lambda: 2e9)
    second = write_log(tmp_path / "b.npz", dict(reversed(one.items()))).read_bytes()
    assert first == second
    with zipfile.ZipFile(tmp_path / "b.npz") as archive:
        assert {entry.date_time[0] for entry in archive.infolist()} == {1980}


def test_python_objects_are_rejected_and_the_old_log_stays(tmp_path):
    path = write_log(tmp_path / "log.npz", {"a": [1.0]})
    with pytest.raises(ValueError, match="'b' must hold numbers or strings, got dtype"):
        write_log(path, {"b": np.array([None])})
    assert read_log(path)["a"] == [1.0]
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("size", [0, 10, 200])
def test_what_is_no_log_is_refused(tmp_path, size):
    path = write_log(tmp_path / "log.npz", {"a": np.arange(100)})
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(ValueError, match=r"log\.npz|pickle|data"):
        read_log(path)
