import errno
import os
from pathlib import Path

import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.objects.meshes.cache import cache_folder, cached_folder, copy_folder


class Maker:
    """Fills folders, and counts how often."""

    def __init__(self):
        self.count = 0

    def __call__(self, folder):
        self.count += 1
        (folder / "model.sdf").write_text("model")


def test_the_cache_follows_xdg(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "drake_srg" / "objects"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path.home() / ".cache" / "drake_srg" / "objects"


def test_a_folder_is_made_once():
    make = Maker()
    folders = {cached_folder("key", make) for _ in range(3)}
    assert (len(folders), make.count) == (1, 1)
    assert (folders.pop() / "model.sdf").read_text() == "model"


@pytest.mark.parametrize("damage", ["change", "remove", "manifest", "no manifest"])
def test_a_damaged_folder_is_made_again(damage):
    make = Maker()
    folder = cached_folder("key", make)
    match damage:
        case "change":
            (folder / "model.sdf").write_text("mode")
        case "remove":
            (folder / "model.sdf").unlink()
        case "manifest":
            (folder / "files.json").write_text("[1]")
        case _:
            (folder / "files.json").unlink()
    assert (cached_folder("key", make) / "model.sdf").read_text() == "model"
    assert make.count == 2


def test_a_failure_leaves_nothing():
    def fail(folder):
        (folder / "model.sdf").write_text("half")
        raise ScenarioError("broken")

    with pytest.raises(ScenarioError, match="broken"):
        cached_folder("key", fail)
    assert list(cache_folder().iterdir()) == []


def test_the_faster_of_two_processes_wins():
    def make(folder):
        cached_folder("key", lambda other: (other / "a").write_text("first"))
        (folder / "a").write_text("second")

    assert (cached_folder("key", make) / "a").read_text() in ("first", "second")
    assert [path.name for path in cache_folder().iterdir()] == ["key"]


def test_a_cache_that_cannot_be_written_is_told(monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(ScenarioError, match=r"Permission denied \(set XDG_CACHE_HOME"):
        cached_folder("key", Maker())


def test_a_copy_has_no_manifest(tmp_path):
    copy_folder(cached_folder("key", Maker()), tmp_path / "copy")
    assert [path.name for path in (tmp_path / "copy").iterdir()] == ["model.sdf"]
