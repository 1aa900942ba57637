import errno
import os
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pytest

from drake_srg.cli.main import BAD_INPUT, SUCCESS, main
from drake_srg.common.exceptions import ScenarioError
from drake_srg.sweeps.report import write
from drake_srg.sweeps.report.plots import histogram, number, percent, ticks
from drake_srg.sweeps.report.write import write_report
from sweeps.report.made_sweep import CAMERA, FRICTION, UNTRUSTED, made_rows, write_sweep


class Page(HTMLParser):
    """The tags, ids and text of a page, as a browser would read them."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.ids, self._texts = [], [], []
        self.feed(html)
        self.text = " ".join(" ".join(self._texts).split())

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.ids += [value for name, value in attrs if name == "id"]

    def handle_data(self, data):
        self._texts.append(data)


def report(folder, rows, **changes):
    path = write_report(write_sweep(folder, rows, **changes))
    return Page(path.read_text(encoding="utf-8"))


def test_the_page_shows_success_false_reports_failures_and_causes(tmp_path):
    rows = made_rows(1000)
    page = report(tmp_path, rows)
    # 950 of 1000 by Wilson's formula.
    assert "95.0 % 950 of 1,000 trials; 95 % interval 93.5 % to 96.2 %" in page.text
    claims = sum(
        claimed and not success
        for claimed, success in zip(rows["claimed"], rows["success"], strict=True)
    )
    assert claims == rows["failure"].count("misplaced") > 0
    assert f"Wrongly reported done {claims} failed trials" in page.text
    for reason in ("misplaced", "dropped"):
        assert f"{reason} {rows['failure'].count(reason)} " in page.text
    assert "Failures depend on 2 of them" in page.text
    found = [page.text.index(f"{name} : failures are") for name in (CAMERA, FRICTION)]
    assert max(found) < page.text.index("Success rate by quantity")
    assert page.tags.count("tr") > 50  # each failed trial has a row
    assert "The quantities that matter most come first." in page.text
    assert "have finished" not in page.text
    assert "--record failures" in page.text  # how to get videos
    assert "a" not in page.tags
    failed = [i for i, success in enumerate(rows["success"]) if not success]
    for trial in failed:
        seed = rows["seed"][trial]
        command = f"drake-srg run kitchen_varied --seed {seed} --set object.mass=0.3"
        assert command in page.text
    assert (
        "drake-srg sweep kitchen_varied --trials 1000 --seed 100 "
        "--set object.mass=0.3 --set 'object.note=<i>'"
    ) in page.text


def test_tasks_with_several_objects_have_distributions_of_their_own(tmp_path):
    rows = made_rows(60)
    assert "Objects left" not in report(tmp_path / "one", rows).text
    counts = {"objects_total": 6, "objects_cleared": 5, "picks": 8, "picks_held": 5}
    several = rows | {name: [count] * 60 for name, count in counts.items()}
    page = report(tmp_path / "several", several)
    assert "Objects left median 1, 95 % quantile 1" in page.text
    assert "Picks not seen to hold median 3, 95 % quantile 3" in page.text
    assert "wrong bin" not in page.text


def test_markup_in_rows_and_yaml_stays_text(tmp_path):
    page = report(tmp_path, made_rows(60))
    assert UNTRUSTED in page.text
    assert "</pre><script>document.title = 'broken'</script>" in page.text
    assert not {"script", "b", "i", "link", "iframe"} & set(page.tags)
    assert len(page.ids) == len(set(page.ids))


def test_noise_is_not_shown_as_a_cause(tmp_path):
    page = report(tmp_path, made_rows(400, effects=False, failure_rate=0.015))
    assert "Nothing stands out as a cause of failures" in page.text
    assert "With 6 failed trials, only strong effects would show." in page.text
    assert "most come first" not in page.text


@pytest.mark.parametrize(
    ("rate", "said"),
    [(0.0, "No trial failed, so none"), (1.0, "All trials failed, so nothing")],
)
@pytest.mark.parametrize("trials", [1, 2, 30])
def test_sweeps_without_or_with_only_failures_have_a_page(tmp_path, rate, said, trials):
    page = report(tmp_path, made_rows(trials, failure_rate=rate), asked=trials + 1)
    assert f"{trials} of {trials + 1} trials have finished" in page.text
    assert (
        said if trials == 30 else "Too few trials have finished to tell"
    ) in page.text
    assert f"{0 if rate else trials} of {trials} trials" in page.text


def test_a_sweep_of_errors_has_a_page(tmp_path):
    rows = {
        "trial": list(range(10)),
        "seed": list(range(100, 110)),
        "success": [False] * 10,
        "failure": ["error"] * 10,
        "message": ["RuntimeError: no"] * 10,
        "claimed": [False] * 10,
    }
    page = report(tmp_path, rows)
    assert "Nothing was varied between the trials." in page.text
    assert "No trial has a value." in page.text


def test_what_no_trial_has_and_outcomes_of_episodes_are_left_out(tmp_path):
    rows = made_rows(60)
    for name in ("grasp_lifted", "placement_error_m", "cycle_time_s"):
        rows[name] = [None] * 60
    rows["episode.return"] = [float(success) for success in rows["success"]]
    page = report(tmp_path, rows)
    for words in (
        *("of 0 trials", "Grasped and lifted", "until it is placed", "has a value"),
        "episode.",  # no cause
    ):
        assert words not in page.text


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_equal_values_have_an_axis_that_one_can_read(value):
    values = np.full(10, value)
    plot = histogram(values, np.ones(10, dtype=bool), label="x")
    texts = [e.text or "" for e in ElementTree.fromstring(plot).iter("text")]
    assert not any("e-" in text for text in texts), texts
    assert "".join(texts).count(f"{value:g}")


def test_equal_rows_give_equal_pages(tmp_path):
    folder = write_sweep(tmp_path, made_rows(100))
    once = write_report(folder).read_bytes()
    assert write_report(folder, tmp_path / "sub/other.html").read_bytes() == once


@pytest.mark.slow
def test_the_page_contains_videos_of_the_worst_trials_up_to_a_size(
    tmp_path, monkeypatch
):
    rows = made_rows(100, failure_rate=0.12)
    folder = write_sweep(tmp_path, rows)
    failed = [i for i, success in enumerate(rows["success"]) if not success][:12]
    record(folder, failed, "video.mp4", b"video")

    def videos():
        html = write_report(folder).read_text()
        return html.count("data:video/mp4;base64,dmlkZW8="), html

    assert videos()[0] == 8
    assert "4 more are in the sweep" in videos()[1]
    monkeypatch.setattr(write, "VIDEO_BYTES", 17)
    assert videos()[0] == 3
    left_out = re.search(r"9 more are in the sweep's folder: (\S+),", videos()[1])
    assert (folder / left_out[1]).is_file()


@pytest.mark.parametrize(("jobs", "words"), [(1, "one worker"), (None, "2 workers")])
def test_throughput_does_not_count_replaced_workers(tmp_path, jobs, words):
    rows = made_rows(20) | {"trial_time_s": [9.0] * 20}
    page = report(tmp_path, rows, jobs=jobs)
    rate = 400 if jobs else 800
    assert f"{rate} trials an hour, {words}" in page.text


@pytest.mark.parametrize("started", ["", "yesterday"])
def test_an_unknown_date_is_shown_as_it_is(tmp_path, started):
    page = report(tmp_path, made_rows(3), started=started)
    assert f"started {started or 'at an unknown time'}" in page.text


def test_a_folder_without_a_sweep_or_without_trials_is_an_error(tmp_path):
    with pytest.raises(ScenarioError, match="no sweep"):
        write_report(tmp_path)
    folder = write_sweep(tmp_path / "new", {"trial": []}, asked=10)
    (folder / "trials.parquet").unlink()
    with pytest.raises(ScenarioError, match="no trial has finished yet"):
        write_report(folder)
    assert not (folder / "report.html").exists()


def test_the_command_prints_the_path_of_the_page(tmp_path, capsys):
    folder = write_sweep(tmp_path, made_rows(20))
    assert main(["report", str(folder)]) == SUCCESS
    assert capsys.readouterr().out == f"{folder / 'report.html'}\n"
    other = tmp_path / "other.html"
    assert main(["report", str(folder), "-o", str(other)]) == SUCCESS
    assert other.read_bytes() == (folder / "report.html").read_bytes()


def test_the_command_reports_errors_in_one_line(tmp_path, capsys):
    folder = write_sweep(tmp_path / "sweep", made_rows(20))
    (tmp_path / "file").touch()
    for arguments, part in (
        ([str(tmp_path)], "no sweep"),
        ([str(folder), "-o", str(tmp_path)], "-o"),
        ([str(folder), "-o", str(tmp_path / "file" / "x.html")], "x.html"),
    ):
        assert main(["report", *arguments]) == BAD_INPUT
        error = capsys.readouterr().err
        assert part in error
        assert error.count("\n") == 1


def test_an_unreadable_video_is_named_and_not_the_page(tmp_path, capsys, monkeypatch):
    folder = write_sweep(tmp_path, made_rows(20))
    record(folder, [3], "video.mp4", b"video")
    video = folder / "recordings/000003/video.mp4"
    read_bytes = Path.read_bytes

    def forbidden(self):
        if self == video:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))
        return read_bytes(self)

    monkeypatch.setattr(Path, "read_bytes", forbidden)
    assert main(["report", str(folder)]) == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"drake-srg: {video}: cannot be read: Permission denied"
    assert not (folder / "report.html").exists()


@pytest.mark.parametrize(
    ("share", "trials", "text"),
    [(1.0, 10, "100.0 %"), (0.9999, 10_000, "99.99 %"), (0.991, 1000, "99.1 %")],
)
def test_percentages_have_enough_digits_for_one_trial(share, trials, text):
    assert percent(share, trials) == text


def test_numbers_have_three_digits_and_thousands_commas():
    assert number(0.00123456, "m") == "0.00123 m"
    assert number(12345.6) == "12,346"
    assert number(None, "s") == number(np.nan) == "-"


def bars(figure):
    """Heights of a histogram's bars of successful and of failed trials."""
    return [
        [
            float(bar.get("height"))
            for bar in ElementTree.fromstring(figure).iter("rect")
            if bar.get("class") == kind
        ]
        for kind in ("good", "bad")
    ]


def test_a_histogram_shows_every_trial_once():
    values = np.array([0.5, 1.0, 2.0, 2.0, 3.0, 99.0, np.nan])
    success = np.array([False, True, True, True, True, False, False])
    good, bad = bars(histogram(values, success, label="x"))
    # One failed trial is below the successful ones, one beyond the axis.
    assert good == [bad[0], 2.0 * bad[0], bad[0]]
    assert len(bad) == 2 and bad[0] == bad[1]
    good, bad = bars(histogram(np.round(values), success, label="x", whole=True))
    assert (len(good), len(bad)) == (3, 2)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 1.0, [0.0, 0.5, 1.0]),
        (-0.03, 0.031, [-0.02, 0.0, 0.02]),
        (99.0, 101.5, [99.0, 100.0, 101.0]),
        (5.0, 5.0, [5.0]),
    ],
)
def test_ticks_are_round(low, high, expected):
    assert ticks(low, high, 3) == pytest.approx(expected)


def record(folder, trials, name, content):
    for trial in trials:
        path = folder / f"recordings/{trial:06d}/{name}"
        path.parent.mkdir(parents=True)
        path.write_bytes(content)


@pytest.mark.parametrize("output", [None, "elsewhere/my report.html"])
def test_replays_are_linked_worst_first(tmp_path, output):
    rows = made_rows(40, failure_rate=0.1)
    folder = write_sweep(tmp_path / "a sweep", rows)
    record(folder, range(0, 40, 2), "replay.html", b"page")
    page = write_report(folder, output and tmp_path / output)
    (list_,) = re.findall(r"<p>Replays in 3D.*?</p>", page.read_text())
    links = re.findall(r'href="(.*?)"', list_)
    trials = [int(Path(link).parts[-2]) for link in links]
    assert sorted(trials) == list(range(0, 40, 2))
    failed = [not rows["success"][trial] for trial in trials]
    assert failed == sorted(failed, reverse=True)
    for link in links:
        assert (page.parent / unquote(link)).read_text() == "page"


def test_a_long_list_of_replays_is_cut(tmp_path):
    folder = write_sweep(tmp_path, made_rows(120))
    record(folder, range(120), "replay.html", b"page")
    assert "and 20 more in recordings/" in write_report(folder).read_text()
