"""Videos made in a process of their own."""

import os
import signal

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from drake_srg.objects.config import SoftConfig
from drake_srg.scenario import load_scenario
from drake_srg.simulation import Simulate
from drake_srg.station.plant import AddPlant
from drake_srg.station.video_process import VideoProcess, can_render_apart

SMALL = ["cameras.overview.width=160", "cameras.overview.height=128"]
SHORT = ["object.present=false", *SMALL]  # ends after less than a second
SAME = ("video.mp4", "log.npz", "replay.glb", "timeline.png")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run whose video was made in a process of its own."""
    out = tmp_path_factory.mktemp("recorded")
    Simulate(load_scenario("kitchen", overrides=SHORT), name="kitchen", out=out)
    return out


@pytest.mark.slow
def test_it_makes_the_same_files_as_the_simulation_would(recorded, tmp_path):
    scenario = load_scenario("kitchen", overrides=SHORT)
    Simulate(scenario, name="kitchen", out=tmp_path, video_process=False)
    for name in SAME:
        assert (tmp_path / name).read_bytes() == (recorded / name).read_bytes(), name


@pytest.mark.slow
def test_a_process_that_dies_is_told_and_the_rest_is_kept(tmp_path, monkeypatch):
    send, told = VideoProcess.send, []

    def send_and_die(self, *message):
        send(self, *message)
        if len(message) == 4:  # a frame
            self._process.kill()

    monkeypatch.setattr(VideoProcess, "send", send_and_die)
    scenario = load_scenario("kitchen", overrides=SHORT)
    result = Simulate(scenario, out=tmp_path, tell=told.append)
    assert told == ["no video: the process that renders it died (SIGKILL)"]
    assert result.metrics.artifacts["video"] is None
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"metrics.json", "recording.mcap", "replay.html"}
    assert "video.mp4" not in names


@pytest.mark.slow
def test_it_films_an_object_that_a_card_hides_from_the_localizer(tmp_path):
    scenario, told = load_scenario("kitchen_varied", overrides=SMALL), []
    with VideoProcess(scenario, told.append) as process:
        process.send(str(tmp_path / "video.mp4"))
        process.finish()
    assert told == []


@pytest.mark.slow
def test_an_error_of_the_process_is_told_or_raised(tmp_path):
    scenario, told = load_scenario("kitchen", overrides=SMALL), []
    with VideoProcess(scenario, told.append) as process:
        process.send(str(tmp_path / "missing" / "video.mp4"))
        plant, _ = AddPlant(DiagramBuilder(), scenario)
        state = plant.get_state_output_port().Eval(plant.CreateDefaultContext())
        process.send(0.0, None, state, [])
        with pytest.raises(FileNotFoundError):
            process.finish()
    with VideoProcess(scenario, told.append) as process:
        process.send(str(tmp_path / "video.mp4"))
        process.send(0.0, None, [1.0, 2.0], [])  # not a state of this plant
        assert process.finish() == 0
    (line,) = told
    assert line.startswith("no video: ")
    assert "Traceback" not in line


def test_a_process_that_hangs_is_told_and_ended(tmp_path):
    scenario, told = load_scenario("kitchen", overrides=SMALL), []
    with VideoProcess(scenario, told.append, patience=0.2) as process:
        os.kill(process._process.pid, signal.SIGSTOP)
        process.send(str(tmp_path / "video.mp4"))
        for _ in range(3):  # more than the pipe holds
            process.send(0.0, None, np.zeros(1 << 17), [])
        assert process.finish() == 0
    assert told == [
        "no video: the process that renders it hung (no sign of life for 0.2 s)"
    ]


def test_a_process_that_hangs_at_the_end_is_told(tmp_path):
    told = []
    with VideoProcess(load_scenario("kitchen"), told.append, patience=0.2) as process:
        os.kill(process._process.pid, signal.SIGSTOP)
        assert process.finish() == 0
    assert len(told) == 1


def test_it_ends_quietly_if_the_simulation_has_died(tmp_path, capfd):
    with VideoProcess(load_scenario("kitchen", overrides=SMALL), print) as process:
        process.send(str(tmp_path / "video.mp4"))
        process._process.stdout.close()
        process.send()
        process._process.stdin.close()
        assert process._process.wait() == 0
    assert "Traceback" not in capfd.readouterr().err


def test_it_ends_with_its_block():
    process = VideoProcess(load_scenario("kitchen"), print)
    with pytest.raises(ZeroDivisionError), process:
        raise ZeroDivisionError
    assert process._process.poll() is not None


def test_not_every_video_can_be_made_apart():
    scenario = load_scenario("kitchen")
    assert can_render_apart(scenario)
    scenario.objects["soup_can"].soft = SoftConfig()
    assert not can_render_apart(scenario)
    scenario = load_scenario("kitchen", overrides=["recording.video_camera=''"])
    assert not can_render_apart(scenario)
