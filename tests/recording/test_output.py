import gc
import sys

import pytest

from drake_srg.recording.output import OutputFile, Recorder, require


def test_a_file_appears_when_it_is_complete(tmp_path):
    target = tmp_path / "new" / "folder" / "file.txt"
    output = OutputFile(target)
    output.path.write_text("half")
    assert not target.exists()
    output.path.write_text("whole")
    assert output.commit() == target
    assert target.read_text() == "whole"
    assert list(target.parent.iterdir()) == [target]


def test_what_was_there_stays_until_then(tmp_path):
    target = tmp_path / "file.txt"
    target.write_text("old")
    output = OutputFile(target)
    output.path.write_text("new")
    assert target.read_text() == "old"
    output.commit()
    assert target.read_text() == "new"


def test_a_discarded_or_forgotten_file_leaves_nothing(tmp_path):
    output = OutputFile(tmp_path / "a.txt")
    output.path.write_text("half")
    output.discard()
    output = OutputFile(tmp_path / "b.txt")
    output.path.write_text("half")
    with pytest.warns(ResourceWarning):
        del output
        gc.collect()
    assert list(tmp_path.iterdir()) == []


def test_an_impossible_folder_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"Cannot write .*video\.mp4.*Choose a folder"):
        OutputFile(tmp_path / "file" / "video.mp4")


def test_a_missing_package_is_named_with_its_cure(monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(
        ImportError, match=r"'rosbags'.* -m pip install .*\[recording\]"
    ):
        require("rosbags.rosbag2")


class Pages(Recorder):
    """Writes a file that some error does not let be finished."""

    def __init__(self, path, error=None):
        super().__init__()
        self._output, self.error = OutputFile(path), error
        self._output.path.write_text("half")

    def _finish(self):
        if self.error:
            raise self.error
        self._output.path.write_text("whole")
        return True


def test_a_recording_that_cannot_be_finished_leaves_what_was_there(tmp_path):
    path = tmp_path / "pages"
    path.write_text("old")
    with pytest.raises(OSError, match="full"), Pages(path, OSError("full")):
        pass
    with pytest.raises(KeyboardInterrupt), Pages(path, KeyboardInterrupt()):
        pass
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "old"


def test_the_first_error_is_the_one_that_is_told(tmp_path):
    with pytest.raises(ZeroDivisionError), Pages(tmp_path / "pages", OSError("full")):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_a_recorder_is_finished_once(tmp_path):
    recorder = Pages(tmp_path / "pages")
    recorder.close()
    recorder.error = AssertionError("again")
    recorder.close()
    assert recorder.path.read_text() == "whole"
