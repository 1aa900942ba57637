import pytest
from replay.tiny_scene import record

from drake_srg.cli import commands
from drake_srg.cli.main import main


def test_replay_makes_the_page_again_and_opens_it(tmp_path, capsys, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    record(tmp_path)
    assert main(["replay", str(tmp_path)]) == 0
    page = tmp_path / "replay.html"
    assert capsys.readouterr().out == f"{page}\n"
    first = page.read_bytes()
    assert opened == []
    assert main(["replay", str(tmp_path), "--open"]) == 0
    assert opened == [page.as_uri()]
    assert page.read_bytes() == first


def test_replay_of_two_runs_makes_a_page_of_both(tmp_path, capsys):
    for name in "ab":
        (tmp_path / name).mkdir()
        record(tmp_path / name, title=f"run {name}")
    folders = [str(tmp_path / name) for name in "ab"]
    page = tmp_path / "both.html"
    assert main(["replay", *folders, "-o", str(page)]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    assert page.read_text().count("<iframe") == 2
    assert main(["replay", *folders]) == 0
    assert (tmp_path / "a/compare.html").read_bytes() == page.read_bytes()
    assert main(["replay", folders[0], "-o", str(page)]) == 2
    assert "-o: needs several folders" in capsys.readouterr().err


@pytest.mark.parametrize("code", [0, 1])
def test_demo_is_a_recorded_run_of_the_kitchen(code, tmp_path, capsys, monkeypatch):
    ran, opened = [], []
    monkeypatch.setattr(commands, "run", lambda options: ran.append(options) or code)
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    assert main(["demo", "--out", str(tmp_path), "--open"]) == code
    (options,) = ran
    assert (options.scenario, options.out) == ("kitchen", tmp_path)
    assert opened == [(tmp_path / "replay.html").as_uri()]


def test_without_a_browser_the_page_is_there_nevertheless(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    record(tmp_path)
    assert main(["replay", str(tmp_path), "--open"]) == 2
    assert "--open: no browser found" in capsys.readouterr().err
    assert (tmp_path / "replay.html").is_file()
