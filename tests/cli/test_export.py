import json

import pytest

from drake_srg.cli.main import main

BENCH = ["export", "gripper_bench"]


def test_export_prints_its_files_and_the_error_of_the_wires(tmp_path, capsys):
    assert main([*BENCH, "--mjcf", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    for name in ("arm", "gripper", "scene"):
        path = tmp_path / "out" / f"{name}.xml"
        assert path.is_file()
        assert str(path) in printed
    assert "Moment arms of the tendons: within 0.25% of the wires'." in printed


def test_json_names_every_model(tmp_path, capsys):
    assert main([*BENCH, "--urdf", str(tmp_path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["moment_arm_error"] is None
    assert answer["models"]["gripper"] == str(tmp_path / "gripper.urdf")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["export", "nowhere", "--sdf", "out"], "'nowhere'"),
        ([*BENCH, "--sdf", "file/out"], "--sdf file/out: cannot be written"),
        (
            [*BENCH, "--set", "object={soft: {edge: 0.02}}", "--sdf", "out"],
            "soft",
        ),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path, monkeypatch, capsys, arguments, words
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_folder_in_the_way_of_a_file_stops_all_files(tmp_path, capsys):
    (tmp_path / "gripper.urdf").mkdir()
    assert main([*BENCH, "--urdf", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--urdf {tmp_path}: cannot be written: Is a directory" in line
    assert [path.name for path in tmp_path.iterdir()] == ["gripper.urdf"]
    assert not list((tmp_path / "gripper.urdf").iterdir())


@pytest.mark.parametrize("formats", [[], ["--urdf", "a", "--sdf", "b"]])
def test_exactly_one_format_is_asked_for(formats, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([*BENCH, *formats])
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--urdf" in line
