import contextlib
import gc
import zipfile

import numpy as np
import pytest
from helpers import damaged
from hypothesis import given
from hypothesis import strategies as st

from drake_srg.recording.output import (
    OutputFile,
    Recorder,
    output_folder,
    read_log,
    write_log,
)


def test_a_file_appears_once_it_is_complete(tmp_path):
    target = tmp_path / "new" / "folder" / "file.txt"
    output = OutputFile(target)
    output.path.write_text("half")
    assert not target.exists()
    output.path.write_text("whole")
    assert output.commit() == target
    assert target.read_text() == "whole"
    assert list(target.parent.iterdir()) == [target]


def test_an_existing_file_stays_until_then(tmp_path):
    target = tmp_path / "file.txt"
    target.write_text("old")
    output = OutputFile(target)
    output.path.write_text("new")
    assert target.read_text() == "old"
    output.commit()
    assert target.read_text() == "new"


def test_a_discarded_or_forgotten_file_leaves_nothing_behind(tmp_path):
    output = OutputFile(tmp_path / "a.txt")
    output.path.write_text("half")
    output.discard()
    output = OutputFile(tmp_path / "b.txt")
    output.path.write_text("half")
    del output
    gc.collect()
    assert list(tmp_path.iterdir()) == []


def test_an_error_names_the_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileExistsError) as caught:
        OutputFile(tmp_path / "file" / "video.mp4")
    assert caught.value.filename == str(tmp_path / "file")


def test_a_folder_made_for_results_stays_if_there_are_any(tmp_path):
    with output_folder(tmp_path / "a" / "b"):
        (tmp_path / "a" / "b" / "result").touch()
    assert (tmp_path / "a" / "b" / "result").exists()
    with output_folder(None):
        pass


def test_a_folder_made_for_nothing_is_removed_after_an_error(tmp_path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(ZeroDivisionError), output_folder(tmp_path / "mine/a/b"):
        raise ZeroDivisionError
    assert list(tmp_path.rglob("*")) == [tmp_path / "mine"]
    with pytest.raises(ZeroDivisionError), output_folder(tmp_path / "mine/a/b"):
        (tmp_path / "mine/a/log").touch()
        raise ZeroDivisionError
    assert sorted(p.name for p in (tmp_path / "mine").rglob("*")) == ["a", "log"]


def test_an_unwritable_folder_fails_before_anything_runs(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError), output_folder(tmp_path / "file" / "out"):
        pytest.fail("ran")


class Pages(Recorder):
    """Writes a file, or raises an error when it is about to complete it."""

    def __init__(self, path, error=None):
        super().__init__()
        self._begin(path)
        self.error = error
        self._output.path.write_text("half")

    def _finish(self):
        if self.error:
            raise self.error
        self._output.path.write_text("whole")
        return True


def test_a_recording_that_cannot_be_completed_leaves_the_old_file(tmp_path):
    path = tmp_path / "pages"
    path.write_text("old")
    with pytest.raises(OSError, match="full"), Pages(path, OSError("full")):
        pass
    with pytest.raises(KeyboardInterrupt), Pages(path, KeyboardInterrupt()):
        pass
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "old"


def test_the_first_error_is_the_one_raised(tmp_path):
    with pytest.raises(ZeroDivisionError), Pages(tmp_path / "pages", OSError("full")):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_closing_a_recorder_twice_completes_its_file_once(tmp_path):
    recorder = Pages(tmp_path / "pages")
    recorder.close()
    recorder.error = AssertionError("again")
    recorder.close()
    assert recorder.path.read_text() == "whole"


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
    with pytest.raises(ValueError, match=r"log\.npz"):
        read_log(path)


@given(data=st.data())
def test_a_damaged_log_is_refused_or_still_a_log(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("log") / "log.npz"
    write_log(path, {"a": np.arange(10.0), "b": np.array(["x"])})
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    with contextlib.suppress(ValueError, OSError):
        read_log(path)
