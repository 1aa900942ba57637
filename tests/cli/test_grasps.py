"""`drake-srg grasps`."""

import json

import pytest
from objects.meshes.made_meshes import box, write_obj
from sweeps.stub import InlineEngine

from drake_srg.cli import grasps as cli_grasps
from drake_srg.cli.main import main
from drake_srg.planning.grasps import sampled_grasps


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli_grasps, "make_engine", lambda options: InlineEngine())
    monkeypatch.setattr(sampled_grasps, "_PER_DIRECTION", 1)


def test_a_mesh_gets_labels_and_a_picture(tmp_path, capsys):
    write_obj(tmp_path / "block.obj", box([0.05, 0.04, 0.09]))
    assert main(["grasps", "block.obj", "--n", "4", "--check", "1", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["grasps"] == 4
    assert answer["checked"] == 1
    assert (tmp_path / "out/grasps/block_srg.yaml").read_text().startswith("format:")
    assert (tmp_path / "out/grasps/block_srg.png").stat().st_size > 1000
    assert main(["grasps", "block.obj", "--n", "4"]) == 2
    assert "already exists" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["mugg"], "unknown object 'mugg' (did you mean 'mug'?"),
        (["no.obj"], "no such file"),
        (["mug", "--n", "0"], "--n 0: must be at least 1"),
        (["mug", "--check", "-1"], "--check -1: must be at least 0"),
        (["mug", "--seed", "-1"], "--seed -1: must be at least 0"),
        (["mug", "--scale", "0"], "--scale 0.0: must be greater than 0"),
        (["mug", "-o", "x.csv"], "--out x.csv: must end in .yaml or .yml or .parquet"),
        (["mug", "-o", "no/x.yaml"], "the folder no is missing"),
    ],
)
def test_bad_input_is_one_line(arguments, message, capsys, tmp_path):
    assert main(["grasps", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_mesh_that_is_not_closed_is_told(tmp_path, capsys):
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    (tmp_path / "sheet.obj").write_text(corners)
    assert main(["grasps", "sheet.obj", "--n", "1"]) == 2
    error = capsys.readouterr().err
    assert "sheet.obj" in error
    assert error.count("\n") == 1


def test_ctrl_c_leaves_no_file(monkeypatch, tmp_path):
    from drake_srg.learning import grasp_labels

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(grasp_labels, "label_grasps", interrupted)
    assert main(["grasps", "mug", "--n", "2", "-o", "mug.yaml"]) == 130
    assert not list(tmp_path.glob("mug*"))
