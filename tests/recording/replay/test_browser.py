"""The page in a real browser."""

import cv2
import numpy as np
import pytest
from chromium import Chromium
from sweeps.report.test_browser import write_video

from drake_srg.recording.replay import write_comparison, write_page
from recording.replay.tiny_scene import PERIOD, SAMPLES, record

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("replay")


@pytest.fixture(scope="module")
def poses(folder):
    found = record(folder)
    write_video(folder / "made/video.mp4")
    (folder / "made/video.mp4").rename(folder / "video.mp4")
    return found


@pytest.fixture(scope="module")
def url(folder, poses):
    return write_page(folder).as_uri()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Chromium(tmp_path_factory.mktemp("browser")) as browser:
        yield browser


def colors(browser):
    """Return the picture of the scene, (n, 3), RGB."""
    picture = cv2.imdecode(np.frombuffer(browser.screenshot(), np.uint8), 1)
    box = browser.evaluate(
        "(({x, y, width, height}) => [x, y, width, height].map(Math.round))"
        "(document.getElementById('scene').getBoundingClientRect())"
    )
    x, y, width, height = box
    return picture[y : y + height, x : x + width, ::-1].reshape(-1, 3).astype(int)


def test_every_pose_is_the_simulations(browser, url, poses):
    browser.open(f"{url}#t=0")
    for k in (0, 7, 12, SAMPLES - 1):
        browser.evaluate(f"replay.seek({k * PERIOD})")
        for name, exact in poses.items():
            shown = np.array(browser.evaluate(f"replay.pose('{name}')"))
            np.testing.assert_allclose(shown[:3], exact[k].translation(), atol=1e-5)
            wxyz = exact[k].rotation().ToQuaternion().wxyz()
            same = abs(shown[3:] @ np.roll(wxyz, -1))
            assert same == pytest.approx(1, abs=1e-9)


def test_the_page_requests_nothing_and_does_not_complain(browser, url):
    browser.open(f"{url}#t=0.1")
    browser.screenshot()
    assert browser.requests() == [url]
    assert browser.complaints() == []
    # Whatever a page would request is refused, and seen here.
    browser.evaluate(
        "new Promise((done) => Object.assign(new Image(), "
        "{onerror: done, src: 'http://example.invalid/spy.png'}))"
    )
    assert any("Content Security Policy" in str(c) for c in browser.complaints())


def test_the_address_names_the_time(browser, url):
    browser.open(f"{url}#t=0.3")
    assert browser.evaluate("replay.time") == pytest.approx(0.3)
    assert browser.evaluate("replay.mode") == "close"
    assert browser.evaluate("document.getElementById('mode').value") == "close"
    chip = browser.evaluate("document.querySelector('#modes [aria-current]').innerText")
    assert chip == "close"
    # Where the plots' cursors are, and the video.
    shift = browser.evaluate(
        "new DOMMatrix(getComputedStyle(document.querySelector('.cursor')).transform).e"
    )
    width = browser.evaluate("document.querySelector('#plots canvas').clientWidth")
    duration = PERIOD * (SAMPLES - 1)
    assert shift == pytest.approx(44 + (width - 50) * 0.3 / duration, abs=1)
    browser.wait_for("Math.abs(document.querySelector('video').currentTime-0.25)<0.01")
    browser.evaluate("document.querySelector('#modes a').click()")
    browser.wait_for("replay.time === 0")
    assert browser.evaluate("location.hash") == "#t=0.00"


def test_keys_move_the_time(browser, url):
    browser.open(f"{url}#t=0.2")
    for key, time in (
        ("ArrowRight", 0.3),
        ("ArrowLeft", 0.2),
        (".", 0.22),
        (",", 0.2),
        ("End", 0.5),
        ("Home", 0.0),
    ):
        browser.press(key)
        assert browser.evaluate("replay.time") == pytest.approx(time, abs=1e-6)
    browser.press(" ")
    browser.wait_for("replay.time === replay.duration")
    pressed = "document.getElementById('play').ariaPressed"
    browser.wait_for(f"{pressed} === 'false'")


def test_the_scene_shows_its_colours_and_turns(browser, url):
    browser.open(f"{url}#t=0")
    before = colors(browser)
    r, g, b = before.T
    assert np.sum((r > 120) & (g < 0.5 * r) & (b < 0.5 * r)) > 300  # the box
    assert np.sum((g > 90) & (r < 0.7 * g) & (b < 0.7 * g)) > 3000  # the floor
    assert np.sum((b > 90) & (r < 0.7 * b) & (g < 0.7 * b)) > 300  # the ball
    eye = browser.evaluate("replay.view.eye")
    assert eye == pytest.approx([0.2, -2.0, 1.2], abs=1e-3)  # the camera's
    browser.drag((300, 300), (420, 330))
    assert browser.evaluate("replay.view.eye") != pytest.approx(eye, abs=0.1)
    assert np.mean(np.any(colors(browser) != before, axis=1)) > 0.05
    browser.press("r")
    assert browser.evaluate("replay.view.eye") == pytest.approx(eye)


@pytest.mark.parametrize(("width", "dark"), [(390, False), (1280, True)])
def test_the_page_fits_the_width(browser, url, width, dark):
    browser.open(f"{url}#t=0.1", width, dark=dark)
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    sizes = browser.evaluate(
        "[...document.querySelectorAll('canvas, button, select')].map((e) => "
        "[e.clientWidth, e.clientHeight])"
    )
    assert all(w > 40 and h > 20 for w, h in sizes)
    unnamed = (
        "[...document.querySelectorAll('canvas, video, section, nav, input[type=range]'"
        ")].filter((e) => !e.ariaLabel).length"
    )
    assert browser.evaluate(unnamed) == 0
    text = browser.evaluate("getComputedStyle(document.body).color")
    assert (text == "rgb(230, 235, 240)") is dark


def test_without_webgl_the_rest_works(browser, url):
    lost = "HTMLCanvasElement.prototype.getContext = ((get) => function (kind) {"
    lost += " return kind === 'webgl2' ? null : get.call(this, kind); })"
    lost += "(HTMLCanvasElement.prototype.getContext)"
    browser.open(f"{url}#t=0.3", before=lost)
    words = browser.evaluate("document.getElementById('lost').innerText")
    assert words == "No 3D view: this browser has no WebGL 2."
    assert browser.evaluate("replay.mode") == "close"
    assert browser.complaints() == []


def test_two_runs_play_on_one_timeline(browser, folder, url, tmp_path):
    page = write_comparison([folder, folder], tmp_path / "compare.html")
    browser.open(f"{page.as_uri()}#t=0.3")
    browser.wait_for("replay.runs.every((run) => Math.abs(run.time - 0.3) < 1e-6)")
    # What happens in one page happens in the other.
    first = "document.querySelector('iframe').contentDocument"
    browser.evaluate(f"{first}.querySelector('#modes a').click()")
    assert browser.evaluate("replay.runs.map((run) => run.time)") == [0, 0]
    assert browser.evaluate("location.hash") == "#t=0.00"
    browser.press(" ")
    browser.wait_for("replay.time === replay.duration")
    assert browser.evaluate("replay.runs.every((run) => run.time === run.duration)")
    assert browser.requests() in ([page.as_uri()], [page.as_uri(), "about:srcdoc"])
    assert browser.complaints() == []
