import pytest

from reproduce import stamps
from reproduce.stamps import current_stamp, read_stamps, write_stamps
from tools.reproduce.made_rows import rows, write_result, write_stamped


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "fake"


def test_a_result_of_the_same_code_is_current(folder):
    assert current_stamp(folder) is None
    stamp = write_stamped(folder, rows())
    assert current_stamp(folder) == stamp
    assert stamp.seconds == 8.4


@pytest.mark.parametrize("function", ["code_hash", "drake_version"])
def test_a_result_of_other_code_is_not(folder, function, monkeypatch):
    write_stamped(folder, rows())
    monkeypatch.setattr(stamps, function, lambda: "other")
    assert current_stamp(folder) is None


def test_a_result_of_other_parameters_is_not(folder):
    write_stamped(folder, rows())
    write_result(folder, rows(2.0))  # without a stamp: `drake-srg experiment --set`
    assert current_stamp(folder) is None


@pytest.mark.parametrize("file", ["result.json", "stamp.json", "fake.png"])
def test_an_incomplete_result_is_not(folder, file):
    write_stamped(folder, rows())
    (folder / file).unlink()
    assert current_stamp(folder) is None


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"seconds": 1}'])
def test_a_stamp_that_was_cut_off_does_not_count(folder, content):
    write_stamped(folder, rows())
    (folder / "stamp.json").write_text(content)
    assert current_stamp(folder) is None


def test_stamps_survive_a_file(tmp_path):
    made = {name: write_stamped(tmp_path / name, rows()) for name in ("b", "a")}
    path = tmp_path / "stamps.json"
    assert read_stamps(path) == {}
    write_stamps(path, made)
    assert read_stamps(path) == made
    assert list(read_stamps(path)) == ["a", "b"]
