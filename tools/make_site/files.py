"""Tables of the outputs of runs: metrics.json, log.npz and ROS topics."""

from __future__ import annotations

import dataclasses as dc
import functools
import typing

import numpy as np
from pydrake.systems.framework import Diagram
from pydrake.systems.sensors import CameraInfo

from drake_srg.common.systems import input_ports
from drake_srg.robot.serve.commands import station_topics
from drake_srg.robot.serve.loop import MakeServedStation
from drake_srg.robot.serve.pictures import camera_topics
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.simulation.metrics import Metrics
from drake_srg.simulation.recorders import recorded_topics
from drake_srg.simulation.run_log import RunLog
from drake_srg.station import MakeCell
from make_site.field_comments import class_comments
from make_site.markdown import code, table

EXAMPLE = "kitchen"


def metrics_table() -> str:
    """Return the entries of metrics.json."""
    comments = class_comments(Metrics)
    hints = typing.get_type_hints(Metrics)
    rows = [
        (code(field.name), _kind(hints[field.name]), comments.get(field.name, ""))
        for field in dc.fields(Metrics)
    ]
    return table(("entry", "type", "meaning"), rows)


def _kind(hint: object) -> str:
    """Return the words for a type of an entry, as JSON has it."""
    words = str(getattr(hint, "__name__", hint) if isinstance(hint, type) else hint)
    for python, plain in (
        ("list[float]", "list of number"),
        ("None", "null"),
        ("float", "number"),
        ("int", "whole number"),
        ("str", "text"),
        ("bool", "true or false"),
        (" | ", ", "),
    ):
        words = words.replace(python, plain)
    return "mapping" if "dict" in words else words


@functools.cache
def _example() -> tuple[Scenario, Diagram]:
    scenario = load_scenario(EXAMPLE)
    return scenario, MakeCell(scenario)


def log_table() -> str:
    """Return the arrays of log.npz that a run of the kitchen writes."""
    scenario, cell = _example()
    log = RunLog(scenario, cell)
    log.sample(cell.CreateDefaultContext())
    rows = [
        (code(name), "N" if array.ndim == 1 else f"N, {array.shape[1]}")
        for name, array in log.arrays().items()
    ]
    return table(("array", "shape"), rows)


def topics_table() -> str:
    """Return the topics of the kitchen: commands, published and recorded ones."""
    scenario, cell = _example()
    station = MakeServedStation(scenario)
    assert scenario.gripper is not None
    plant = station.GetSubsystemByName("station").GetSubsystemByName("plant")
    inputs = input_ports(station)
    camera = next(iter(scenario.cameras))
    intrinsics = CameraInfo(640, 480, np.pi / 4.0)
    commands = station_topics(plant, inputs, scenario.gripper.joint_names)
    served = {topic.name: topic.type for topic in recorded_topics(station, scenario)}
    pictures = camera_topics(camera, intrinsics).values()
    served |= {topic.name: topic.type for topic in pictures}
    recorded = {topic.name: topic.type for topic in recorded_topics(cell, scenario)}
    uses: dict[tuple[str, str], list[str]] = {}
    for use, topics in (
        ("command", {topic.name: topic.type for topic in commands}),
        ("served", served),
        ("recorded", recorded),
    ):
        for name, kind in topics.items():
            uses.setdefault((name, kind), []).append(use)
    rows = [(code(name), code(kind), ", ".join(u)) for (name, kind), u in uses.items()]
    return table(("topic", "type", "use"), rows)
