import gc
import sys

import pytest

from drake_srg.recording.output import OutputFile, require


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
