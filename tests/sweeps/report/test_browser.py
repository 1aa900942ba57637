"""Reports in a real browser."""

import av
import numpy as np
import pytest
from chromium import Chromium

from drake_srg.sweeps.report.write import write_report
from sweeps.report.browser import look, open_page, wait_for_shade
from sweeps.report.made_sweep import TREE, UNTRUSTED, made_rows, write_sweep

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Chromium(tmp_path_factory.mktemp("browser")) as browser:
        yield browser


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    rows = made_rows(300)
    folder = write_sweep(tmp_path_factory.mktemp("sweep"), rows)
    failed = [trial for trial, success in enumerate(rows["success"]) if not success]
    for trial in failed[:2]:
        write_video(folder / f"recordings/{trial:06d}/video.mp4")
    return write_report(folder)


def write_video(path):
    """Write half a second of video, encoded as by VideoRecorder."""
    path.parent.mkdir(parents=True)
    with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=20)
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        for i in range(10):
            picture = np.full((120, 160, 3), 20 * i, dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        container.mux(stream.encode(None))


@pytest.mark.parametrize("width", [400, 1400])
def test_the_page_is_complete_and_fits_the_width(browser, page, width):
    seen = look(browser, page, width)
    assert seen["complaints"] == []
    assert seen["loaded"] == []
    assert seen["scripts"] == 0
    assert seen["unnamed"] == 0
    assert seen["width"] == width
    assert seen["scroll_width"] <= width
    assert seen["sticking_out"] == []
    assert seen["headings"] == [
        "kitchen_varied",
        "Failures",
        "What matters",
        "Distributions",
        "Worst trials",
        "Time and memory",
        "Scenario and versions",
    ]


def test_every_frame_of_a_video_can_be_shown(browser, page):
    open_page(browser, page)
    assert browser.evaluate("document.querySelectorAll('video').length") == 2
    for i in range(2):
        video = f"document.querySelectorAll('video')[{i}]"
        browser.wait_for(f"{video}.readyState > 1")
        size = browser.evaluate(f"[{video}.videoWidth, {video}.videoHeight]")
        assert size == [160, 120]
        assert browser.evaluate(f"{video}.controls")
        duration = browser.evaluate(f"{video}.duration")
        assert duration == pytest.approx(0.5, abs=0.06)  # a frame
        # Frame k has the shade 20 k, and is shown from k / 20 s on.
        for time in (0.125, 0.425):
            shade = 20 * int(20 * time)
            wait_for_shade(browser, video, time, shade, within=5)  # H.264's loss


def test_text_of_scenarios_and_trials_is_shown_verbatim(browser, page, tmp_path):
    opened = tmp_path / "opened.html"
    text = page.read_text(encoding="utf-8")
    opened.write_text(text.replace("<details", "<details open"), encoding="utf-8")
    seen = look(browser, opened)
    assert seen["title"] == "kitchen_varied: 300 trials"
    assert UNTRUSTED in seen["text"]
    assert TREE.strip() in seen["text"]
    assert "--set 'object.note=<i>'" in seen["text"]


def test_the_page_requests_nothing_whatever_text_it_contains(browser, page, tmp_path):
    spied = tmp_path / "spied.html"
    picture = '<img alt="" src="http://127.0.0.1:9/spy.png">'
    text = page.read_text(encoding="utf-8")
    spied.write_text(text.replace("<main>", f"<main>{picture}"), encoding="utf-8")
    seen = look(browser, spied)
    assert seen["loaded"] == []
    assert "Content Security Policy" in str(seen["complaints"])
    # Without the page's policy the browser requests it.
    spied.write_text(f"<!DOCTYPE html><body>{picture}", encoding="utf-8")
    assert look(browser, spied)["loaded"] == ["http://127.0.0.1:9/spy.png"]


def test_the_browser_finds_what_a_page_must_not_do(browser, tmp_path):
    bad = tmp_path / "bad.html"
    bad.write_text(
        "<!DOCTYPE html><title>bad</title><p style='width:3000px'>x</p><svg></svg>"
        "<script>console.error('bad')</script>",
        encoding="utf-8",
    )
    seen = look(browser, bad)
    assert seen["complaints"]
    assert seen["scripts"] == seen["unnamed"] == 1
    assert seen["scroll_width"] >= 3000
    assert seen["sticking_out"]
