import json
import re
import shutil

import cv2
import numpy as np
import pytest

from drake_srg.common.exceptions import ScenarioError
from drake_srg.recording.output import write_log
from drake_srg.recording.replay import write_page
from drake_srg.recording.replay.glb import write_glb
from recording.replay.tiny_scene import made_log, record

TITLE = "</script><b>&\"'kitchen"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    record(folder)
    return folder


@pytest.fixture
def folder(recorded, tmp_path):
    """A copy of the recording, for tests that change it."""
    return shutil.copytree(recorded, tmp_path / "copy")


def shown(page):
    """Return the data of a page's scripts."""
    text = page.read_text(encoding="utf-8")
    (data,) = re.findall(r'<script type="application/json" id="data">(.*?)</', text)
    return json.loads(data)


def test_the_page_has_the_log(folder):
    data = shown(write_page(folder))
    log = made_log()
    assert data["duration"] == pytest.approx(log["time"][-1])
    assert [m["mode"] for m in data["modes"]] == ["pre grasp", "close"]
    labels = [panel["label"] for panel in data["panels"]]
    assert labels == [
        "finger joints [deg]",
        "proximity [mm]",
        "grip force [N]",
        "arm velocity [deg/s]",
        "arm torque [N m]",
        "object height [mm]",
    ]
    (force,) = data["panels"][2]["series"]
    np.testing.assert_allclose(force["values"], log["contact_force"], rtol=1e-3)
    (near,) = data["panels"][1]["series"]
    assert near["values"][0] is None  # nothing in range
    assert near["name"] == "left"


def test_equal_recordings_give_equal_pages(folder):
    first = write_page(folder).read_bytes()
    assert write_page(folder).read_bytes() == first


def test_the_page_loads_nothing_from_elsewhere(folder):
    (folder / "video.mp4").write_bytes(b"video")
    text = write_page(folder).read_text(encoding="utf-8")
    assert "default-src &#x27;none&#x27;" in text
    sources = re.findall(r'\b(?:src|href)="([^"]*)"', text)
    assert [s.partition(";")[0] for s in sources] == ["data:video/mp4"]


@pytest.mark.parametrize(
    ("metrics", "words"),
    [
        ({"success": True, "attempts": 1}, "success, 1 attempt<"),
        (
            {"success": True, "attempts": 1, "kinds": {"clutter_1": "banana"}},
            "success, 1 attempt; clutter_1 is banana<",
        ),
        (
            {
                **{"success": True, "attempts": 7},
                **{"objects_total": 6, "objects_cleared": 5},
            },
            "success, 5 of 6 objects cleared, 7 picks<",
        ),
        (
            {"success": False, "attempts": 2, "failure": "no_grasp"},
            "failure: no_grasp, 2 attempts<",
        ),
        ({"success": True}, None),
        ([], None),
    ],
)
def test_the_result_is_told_if_it_is_known(folder, metrics, words):
    (folder / "metrics.json").write_text(json.dumps(metrics))
    header = re.search(r"<header>.*</header>", write_page(folder).read_text())[0]
    assert header.count("<p") == (words is not None)
    assert (words or "") in header


def test_text_of_a_scenario_is_no_markup(tmp_path):
    record(tmp_path, title=TITLE)
    text = write_page(tmp_path).read_text(encoding="utf-8")
    assert TITLE not in text
    assert text.count("</script>") == 3
    assert "&lt;/script&gt;&lt;b&gt;&amp;&quot;&#x27;kitchen" in text


def test_what_the_localizer_saw_is_shown(folder):
    picture = cv2.imencode(".jpg", np.zeros((4, 4, 3), np.uint8))[1].tobytes()
    blob = {"name": "can", "at": [0.25, 0.5], "quality": 1.0}
    sight = {"time": 0.2, "camera": "ceiling", "image": 0, "blobs": [blob]}
    labels = {"title": "made", "pick": "box"}
    extras = {"labels": labels, "sights": [sight], "video_start": 0.05}
    (folder / "replay.glb").write_bytes(write_glb([], extras, [picture]))
    page = write_page(folder)
    (found,) = shown(page)["sights"]
    assert found["image"].startswith("data:image/jpeg;base64,")
    assert found["blobs"] == [blob]
    assert 'id="sight"' in page.read_text()


@pytest.mark.parametrize("name", ["replay.glb", "log.npz"])
@pytest.mark.parametrize("how", ["missing", "broken", "another"])
def test_an_incomplete_recording_is_refused(folder, name, how):
    path = folder / name
    if how == "missing":
        path.unlink()
    elif how == "broken":
        path.write_bytes(path.read_bytes()[:100])
    elif name == "replay.glb":
        path.write_bytes(write_glb([], {"labels": {"unknown": 1}}))
    else:
        write_log(path, {"time": np.zeros(3)})
    with pytest.raises(ScenarioError, match=f"copy/{name}: "):
        write_page(folder)
    assert not (folder / "replay.html").exists()


def test_a_missing_folder_is_not_made(tmp_path):
    with pytest.raises(ScenarioError, match=r"replay\.glb: No such file"):
        write_page(tmp_path / "none")
    assert not (tmp_path / "none").exists()
