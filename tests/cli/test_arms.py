import json

import pytest
from importing.made_arms import six_axes, two_axes

from drake_srg.cli.main import main
from drake_srg.scenario import load_scenario


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """The folder of an arm that was imported."""
    folder = tmp_path_factory.mktemp("arms")
    (folder / "six.urdf").write_text(six_axes())
    out = folder / "out"
    assert main(["import-arm", str(folder / "six.urdf"), "-o", str(out)]) == 0
    return out


def test_an_import_makes_model_scenario_picture_and_report(imported):
    names = {path.name for path in imported.iterdir()}
    assert {"model.sdf", "arm.yaml", "arm.png", "arm.json"} <= names
    report = json.loads((imported / "arm.json").read_text())
    assert report["problems"] == []
    assert report["places_within_reach"] == 1.0
    assert report["effort"] == [200, 200, 150, 40, 40, 40]
    assert report["check"]["moved"] < 0.002


def test_the_folder_can_be_moved(imported, tmp_path):
    moved = imported.rename(tmp_path / "moved")
    try:
        scenario = load_scenario(moved / "arm.yaml")
        assert len(scenario.arm.home) == 6
        assert scenario.arm.kp is None
    finally:
        moved.rename(imported)


def test_the_arm_does_the_kitchens_task(imported, tmp_path):
    text = (imported / "arm.yaml").read_text()
    fast = imported / "fast.yaml"
    fast.write_text(text.replace("base: kitchen", "base: kitchen_fast"))
    out = tmp_path / "run"
    assert main(["run", str(fast), "-o", str(out), "--no-record"]) == 0
    assert json.loads((out / "metrics.json").read_text())["success"]


@pytest.mark.parametrize(
    ("name", "text", "options", "words"),
    [
        ("a.obj", "hello", [], ["a.obj", "unknown format", ".urdf"]),
        ("a.urdf", "hello", [], ["a.urdf", "cannot be read"]),
        ("b.urdf", two_axes(), [], ["b.urdf", "reaches no place on the table"]),
        ("c.urdf", six_axes(), ["--effort", "1,2"], ["--effort", "per joint (6)"]),
        ("d.urdf", six_axes(), ["--effort", "x"], ["--effort", "invalid"]),
        ("e.urdf", six_axes(), ["--tip", "hand"], ["--tip", "unknown link 'hand'"]),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path, capsys, name, text, options, words
):
    (tmp_path / name).write_text(text)
    out = tmp_path / "out"
    try:
        code = main(["import-arm", str(tmp_path / name), "-o", str(out), *options])
    except SystemExit as error:  # of the parser
        code = error.code
    assert code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert all(word in line for word in words), line
    assert not out.exists()
    assert len(list(tmp_path.iterdir())) == 1
