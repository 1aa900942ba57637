import json

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform

from drake_srg.cli.calibrate import parse_board, parse_count
from drake_srg.cli.main import main
from drake_srg.common.exceptions import ScenarioError
from drake_srg.scenario import load_scenario
from experiments.stands.scenes import Eye

# The localizer believes the camera 10 mm and 2 degrees from where it is.
KNOCKED = """base: assistive_arm
camera_errors:
  ceiling: {translation: [0.01, 0, 0], rotation: [0, 0.0349, 0], color_noise: 2.0}
"""


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """The folder of a calibration, and what it printed."""
    folder = tmp_path_factory.mktemp("calibrated")
    (folder / "knocked.yaml").write_text(KNOCKED)
    words = ["calibrate", "camera", str(folder / "knocked.yaml"), "--quiet"]
    assert main([*words, "--images", "6", "--out", str(folder / "out")]) == 0
    return folder


def calibrate(folder, *words):
    images = folder / "out" / "images"
    return main(
        ["calibrate", "camera", "assistive_arm", "--images", str(images), *words]
    )


@pytest.mark.slow
def test_the_scenario_that_it_writes_locates_objects_again(calibrated):
    place = RigidTransform([-0.3, -0.2, 0.125])

    def error(name):
        (blob,) = Eye(load_scenario(calibrated / name)).blobs(place)
        return np.linalg.norm(blob.position - place.translation())

    errors = {name: error(name) for name in ("knocked.yaml", "out/calibration.yaml")}
    assert errors["knocked.yaml"] > 10e-3
    assert errors["out/calibration.yaml"] < 0.5e-3


@pytest.mark.slow
def test_images_in_a_folder_give_the_same_camera(calibrated, tmp_path, capsys):
    assert calibrate(calibrated, "--out", str(tmp_path), "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    truth = load_scenario("assistive_arm").cameras["ceiling"].X_PB
    found = np.array(answer["translation_m"])
    off = np.linalg.norm(found - truth.GetDeterministicValue().translation())
    assert off < min(1e-3, 4.0 * answer["position_std_m"])
    assert answer["errors"] is None
    assert answer["images"] == [f"view_{i:02d}.png" for i in range(6)]
    before = (calibrated / "out" / "calibration.yaml").read_text().splitlines()
    after = (tmp_path / "calibration.yaml").read_text().splitlines()
    assert after[4:] == before[4:]  # all but the names of the scenarios
    assert not (tmp_path / "images").exists()


@pytest.mark.slow
def test_nothing_is_written_if_too_few_images_can_be_used(calibrated, tmp_path, capsys):
    folder = tmp_path / "images"
    folder.mkdir()
    for path in (calibrated / "out" / "images").iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    for i in range(2):
        path = folder / f"view_{i:02d}.png"
        cv2.imwrite(str(path), np.full_like(cv2.imread(str(path)), 128 + i))
    words = ["calibrate", "camera", "assistive_arm", "--images", str(folder)]
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    complaint = capsys.readouterr().err
    assert "4 usable views, needs at least 5 (got 6 images, 4 show the" in complaint
    assert complaint.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["kitchen", "--camera", "eye"], "--camera: unknown camera 'eye' (allowed: "),
        (["gripper_bench"], "--camera: unknown camera ''"),
        (["kitchen", "--images", "3"], "--images: must be 5 .. 200, got 3"),
        (["kitchen", "--images", "none"], "none/poses.csv: cannot be read"),
        (
            ["kitchen", "--board", "7,5,0.04,0.03"],
            "--board: needs a folder of --images",
        ),
        (["nowhere"], "unknown scenario 'nowhere'"),
    ],
)
def test_bad_input_gets_one_line(words, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "camera", *words]) == 2
    complaint = capsys.readouterr().err
    assert message in complaint
    assert complaint.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("6,5,0.04", "must be COLUMNS,ROWS,SQUARE,MARKER"),
        ("6,5,0.04,0.03,DICT_4X4_50,6", "must be COLUMNS,ROWS,SQUARE,MARKER"),
        ("6,five,0.04,0.03", "must be COLUMNS,ROWS,SQUARE,MARKER"),
        ("2,5,0.04,0.03", "needs 3 to 50 columns and rows"),
        ("6,5,0.03,0.04", "needs 0 < MARKER < SQUARE"),
        ("6,5,0.04,nan", "needs 0 < MARKER < SQUARE"),
        ("6,5,0.04,0.03,DICT_9X9", "unknown dictionary 'DICT_9X9' .allowed: DICT_4X4"),
        ("20,20,0.04,0.03", "DICT_4X4_50 has too few markers for 20 x 20 squares"),
    ],
)
def test_a_board_that_does_not_exist_is_refused(text, message):
    with pytest.raises(ScenarioError, match=f"--board: .*{message}|--board: {message}"):
        parse_board(text)


def test_board_and_count_are_read():
    board = parse_board("7,5,0.03,0.02,DICT_5X5_100")
    assert (board.columns, board.square, board.dictionary) == (7, 0.03, "DICT_5X5_100")
    assert parse_count("12") == 12
    assert parse_count("photos") is None
