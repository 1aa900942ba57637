"""Reports in a real browser."""

import http.server
import threading

import av
import numpy as np
import pytest

from drake_srg.sweeps.report.write import write_report
from sweeps.report.browser import Browser
from sweeps.report.made_sweep import TREE, UNTRUSTED, made_rows, write_sweep

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    return Browser(tmp_path_factory.mktemp("browser"))


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    rows = made_rows(300)
    folder = write_sweep(tmp_path_factory.mktemp("sweep"), rows)
    failed = [trial for trial, success in enumerate(rows["success"]) if not success]
    for trial in failed[:2]:
        write_video(folder / f"recordings/{trial:06d}/video.mp4")
    return write_report(folder).read_text(encoding="utf-8")


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
    told = browser.open(page, width)
    assert told["console"] == []
    assert told["loaded"] == []
    assert told["scripts"] == 0
    assert told["unnamed"] == 0
    assert told["width"] == width
    assert told["scroll_width"] <= width
    assert told["sticking_out"] == []
    assert told["headings"] == [
        "kitchen_varied",
        "Failures",
        "What matters",
        "Distributions",
        "Worst trials",
        "Time and memory",
        "Scenario and versions",
    ]


def test_every_frame_of_a_video_can_be_shown(browser, page):
    # Chromium's virtual time does not wait for the decoder of a busy machine.
    for _ in range(5):
        videos = browser.open(page)["videos"]
        if all(shades for *_, shades in videos):
            break
    assert len(videos) == 2
    for width, height, duration, controls, shades in videos:
        assert (width, height, controls) == (160, 120, True)
        assert duration == pytest.approx(0.5, abs=0.06)  # a frame
        # Frame k has the shade 20 k, and is shown from k / 20 s on.
        assert [time for time, _ in shades] == [0.125, 0.425]
        for time, shade in shades:
            assert shade == pytest.approx(20 * int(20 * time), abs=5)  # H.264's loss


def test_text_of_scenarios_and_trials_is_shown_verbatim(browser, page):
    told = browser.open(page.replace("<details", "<details open"))
    assert told["title"] == "kitchen_varied: 300 trials"
    assert UNTRUSTED in told["text"]
    assert TREE.strip() in told["text"]
    assert "--set 'object.note=<i>'" in told["text"]


@pytest.fixture
def server():
    """A web server on this machine, with the paths that were requested."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.server.asked.append(self.path)
            self.send_error(404)

        def log_message(self, *_):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as server:
        server.asked = []
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def test_the_page_requests_nothing_whatever_text_it_contains(browser, page, server):
    picture = f'<img alt="" src="http://127.0.0.1:{server.server_port}/spy.png">'
    told = browser.open(page.replace("<main>", f"<main>{picture}"))
    assert server.asked == []
    assert "Content Security Policy" in told["console"][0]
    # Without the page's policy the browser requests it.
    told = browser.open(f"<!DOCTYPE html><body>{picture}")
    assert server.asked == ["/spy.png"]
    assert len(told["loaded"]) == 1


def test_the_browser_finds_what_a_page_must_not_do(browser):
    told = browser.open(
        "<!DOCTYPE html><title>bad</title><p style='width:3000px'>x</p><svg></svg>"
        "<script>console.error('bad')</script>"
    )
    assert told["console"]
    assert told["scripts"] == told["unnamed"] == 1
    assert told["scroll_width"] >= 3000
    assert told["sticking_out"]
