from drake_srg.recording.replay.glb import EXTRAS
from recording.replay.strict_reader import Strict
from recording.replay.tiny_scene import record


def test_the_file_has_scene_forces_and_labels(tmp_path):
    record(tmp_path, "kitchen, seed 3")
    strict = Strict((tmp_path / "replay.glb").read_bytes())
    extras = strict.document["scenes"][0]["extras"][EXTRAS]
    assert extras["labels"]["title"] == "kitchen, seed 3"
    assert (extras["video_camera"], extras["video_start"]) == ("side", 0.05)
    names = {node["name"] for node in strict.document["nodes"]}
    assert {"box::body", "side", "force of world on box::body"} <= names


def test_a_cell_without_contact_results_has_no_forces(tmp_path):
    record(tmp_path, contacts=False)
    strict = Strict((tmp_path / "replay.glb").read_bytes())
    names = [node["name"] for node in strict.document["nodes"]]
    assert names == ["world", "box::body", "swing::bar", "side", "world (z up)"]
