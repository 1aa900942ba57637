import errno
import os

import pytest

from drake_srg.sweeps.files import remove_partial, write_file, write_folder

from .stub import names


def full_disk(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_file_replaces_an_old_one(tmp_path):
    path = tmp_path / "new" / "row"
    for content in (b"1", b"22"):
        write_file(path, content)
        assert path.read_bytes() == content
    assert names(path.parent) == ["row"]


@pytest.mark.parametrize("moved", [False, True])
def test_a_folder_replaces_an_old_one(tmp_path, moved):
    path, source = tmp_path / "000001", tmp_path / "source"
    write_folder(path, {"a": b"1", "b": b"2"})
    if moved:
        write_folder(source, {"a": b"3"})
    write_folder(path, source if moved else {"a": b"3"})
    assert {p.name: p.read_bytes() for p in path.iterdir()} == {"a": b"3"}
    assert names(tmp_path) == ["000001"]


@pytest.mark.parametrize("write", [write_file, write_folder])
def test_a_full_disk_leaves_the_old_content(write, tmp_path, monkeypatch):
    old, new = (b"1", b"2") if write is write_file else ({"a": b"1"}, {"a": b"2"})
    write(tmp_path / "x", old)
    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write(tmp_path / "x", new)
    path = tmp_path / "x" if write is write_file else tmp_path / "x" / "a"
    assert path.read_bytes() == b"1"
    assert names(tmp_path) == ["x"]


@pytest.mark.parametrize("write", [write_file, write_folder])
def test_an_incomplete_write_is_removed_by_the_next_user(write, tmp_path, monkeypatch):
    content = b"1" if write is write_file else {"a": b"1"}
    monkeypatch.setattr(type(tmp_path), "replace", full_disk)
    monkeypatch.setattr(type(tmp_path), "unlink", lambda *_, **__: None)
    monkeypatch.setattr("shutil.rmtree", lambda *_, **__: None)
    with pytest.raises(OSError, match="No space left"):
        write(tmp_path / "x", content)
    assert len(names(tmp_path)) == 1
    monkeypatch.undo()
    (tmp_path / "mine").touch()
    remove_partial(tmp_path)
    assert names(tmp_path) == ["mine"]
