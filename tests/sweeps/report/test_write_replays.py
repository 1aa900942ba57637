import re
from pathlib import Path
from urllib.parse import unquote

import pytest

from drake_srg.sweeps.report.write import write_report

from .made_sweep import made_rows, write_sweep


@pytest.mark.parametrize("output", [None, "elsewhere/my report.html"])
def test_replays_are_linked_worst_first(tmp_path, output):
    rows = made_rows(40, failure_rate=0.1)
    folder = write_sweep(tmp_path / "a sweep", rows)
    for trial in range(0, 40, 2):
        path = folder / f"recordings/{trial:06d}/replay.html"
        path.parent.mkdir(parents=True)
        path.write_text("page")
    page = write_report(folder, output and tmp_path / output)
    (list_,) = re.findall(r"<p>Replays in 3D.*?</p>", page.read_text())
    links = re.findall(r'href="(.*?)"', list_)
    trials = [int(Path(link).parts[-2]) for link in links]
    assert sorted(trials) == list(range(0, 40, 2))
    failed = [not rows["success"][trial] for trial in trials]
    assert failed == sorted(failed, reverse=True)
    for link in links:
        assert (page.parent / unquote(link)).read_text() == "page"


def test_long_lists_are_cut(tmp_path):
    folder = write_sweep(tmp_path, made_rows(120))
    for trial in range(120):
        path = folder / f"recordings/{trial:06d}/replay.html"
        path.parent.mkdir(parents=True)
        path.write_text("page")
    text = write_report(folder).read_text()
    assert "and 20 more in recordings/" in text


def test_without_recordings_there_are_no_links(tmp_path):
    page = write_report(write_sweep(tmp_path, made_rows(20)))
    assert "href" not in page.read_text()
