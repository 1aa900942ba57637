import json
import sys

import numpy as np
import pytest
from objects.meshes.made_meshes import box, write_obj
from objects.meshes.test_links import CYLINDER, urdf

from drake_srg.cli import objects as cli_objects
from drake_srg.cli.main import main
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import HOUSEHOLD, object_facts
from drake_srg.simulation import rig
from drake_srg.simulation.rig import DropOutcome


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def outcomes(monkeypatch):
    """The outcome of the drop test, in place of a simulation."""
    results = [DropOutcome(True, 1.2, 0.0, 0.0)]
    monkeypatch.setattr(rig, "drop", lambda *_: results[-1])
    return results


def test_import_makes_a_model(tmp_path, capsys, outcomes):
    path = write_obj(tmp_path / "my box.obj", box([0.04, 0.05, 0.06], [0.1, 0, 0]))
    out = tmp_path / "deep" / "out"
    assert main(["import", str(path), "-o", str(out), "--density", "1000"]) == 0
    printed = capsys.readouterr().out
    assert "warning: moved the origin" in printed
    assert "no mass" not in printed
    assert "40.0 x 50.0 x 60.0 mm" in printed
    assert "0.12 kg" in printed
    assert "rests" in printed
    names = sorted(file.name for file in out.iterdir())
    assert names == [
        *("import.json", "model.sdf", "picture.png", "piece_0.obj", "visual_0.obj")
    ]
    facts = object_facts("x", ObjectConfig(model=str(out / "model.sdf")))
    assert facts.mass == pytest.approx(0.12)
    np.testing.assert_allclose(facts.size, [0.04, 0.05, 0.06], atol=1e-6)
    report = json.loads((out / "import.json").read_text())
    assert report["mass"] == pytest.approx(0.12)
    assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_options_are_written_into_the_model(tmp_path, outcomes):
    path = urdf(tmp_path / "a.urdf", CYLINDER)
    options = ["--mass", "0.3", "--friction", "0.25", "--color", "0.1,0.2,0.3"]
    out = tmp_path / "out"
    assert main(["import", str(path), "-o", str(out), *options]) == 0
    text = (out / "model.sdf").read_text()
    assert "<mass>0.3</mass>" in text
    assert "<drake:mu_static>0.25</drake:mu_static>" in text
    assert "<diffuse>0.1 0.2 0.3 1</diffuse>" in text
    assert '<model name="a">' in text


def test_an_object_that_does_not_rest_is_told(tmp_path, capsys, outcomes):
    outcomes.append(DropOutcome(False, 3.0, 0.1, 0.0))
    path = urdf(tmp_path / "a.urdf", CYLINDER)
    assert main(["import", str(path), "-o", str(tmp_path / "out")]) == 1
    assert "does not rest: 100.0 mm/s" in capsys.readouterr().out
    assert (tmp_path / "out" / "model.sdf").is_file()


@pytest.mark.parametrize(
    ("name", "content", "options", "words"),
    [
        ("a.obj", "hello", [], ["a.obj", "no triangles"]),
        ("a.stl", "", [], ["a.stl", "no triangles"]),
        ("a.urdf", "<robot/>", [], ["a.urdf", "one link, got 0"]),
        ("a.txt", "hello", [], ["a.txt", "unknown format", ".urdf"]),
        ("a.obj", "hello", ["--pieces", "0"], ["--pieces", "1 .. 256"]),
        ("a.obj", "hello", ["-o", "."], ["--out .", "already has results (a.obj)"]),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path, capsys, monkeypatch, name, content, options, words
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text(content)
    assert main(["import", name, *options]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert all(word in line for word in words)
    assert not (tmp_path / "out").exists()


def test_a_failure_midway_leaves_nothing(tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise RuntimeError("no picture")

    monkeypatch.setattr("drake_srg.objects.household.take_portrait", fail)
    path = urdf(tmp_path / "a.urdf", CYLINDER)
    out = tmp_path / "made" / "out"
    assert main(["import", str(path), "-o", str(out)]) == 2
    assert "no picture" in capsys.readouterr().err
    assert not out.exists()
    assert list(out.parent.iterdir()) == []


def test_without_the_extra_the_command_is_told(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    path = write_obj(tmp_path / "a.obj", box([0.04] * 3))
    assert main(["import", str(path), "-o", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "pip install" in line
    assert "[import]" in line


@pytest.mark.parametrize(
    "option", ["--mass=0", "--mass=x", "--density=-1", "--color=1,2,3", "--scale=nan"]
)
def test_bad_options_are_one_line(option, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["import", "a.obj", option])
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert option.partition("=")[0] in line


def test_list_objects_shows_sizes_masses_and_pieces(capsys):
    assert main(["list", "--objects"]) == 0
    _, *lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(HOUSEHOLD)
    (can,) = [line for line in lines if line.startswith("005")]
    assert can.split()[1:] == ["68", "x", "68", "x", "102", "349", "1"]


@pytest.mark.slow
def test_pictures_of_all_are_drawn(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(cli_objects, "_PIXELS", 32)
    assert main(["list", "--objects", "-o", str(tmp_path / "p")]) == 0
    names = {path.name for path in (tmp_path / "p").iterdir()}
    assert names == {*(f"{name}.png" for name in HOUSEHOLD), "objects.png"}
    assert str(tmp_path / "p" / "objects.png") in capsys.readouterr().out


def test_a_model_is_kept_unless_it_is_to_be_replaced(tmp_path, capsys, outcomes):
    path = write_obj(tmp_path / "a.obj", box([0.04] * 3))
    out = tmp_path / "out"
    words = ["import", str(path), "-o", str(out), "--quiet"]
    assert main([*words, "--mass", "0.1"]) == 0
    (out / "notes.txt").touch()
    before = (out / "model.sdf").read_text()
    assert main([*words, "--mass", "0.2"]) == 2
    assert f"--out {out}: already has results" in capsys.readouterr().err
    assert (out / "model.sdf").read_text() == before
    assert main([*words, "--mass", "0.2", "--replace"]) == 2  # the notes stay
    (out / "notes.txt").unlink()
    assert main([*words, "--mass", "0.2", "--replace"]) == 0
    assert "<mass>0.2</mass>" in (out / "model.sdf").read_text()
