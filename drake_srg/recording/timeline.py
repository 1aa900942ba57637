"""A picture of a run: modes, gripper, arm and object over time."""

from __future__ import annotations

import dataclasses as dc
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drake_srg.recording.figure import make_figure, save_png, style_axes
from drake_srg.types import Vector

_BANDS = ("#eef2f6", "#dbe4ed")


@dc.dataclass(frozen=True)
class Timeline:
    """What `draw_timeline` shows; panels without values are left out.

    Attributes:
        time: K samples [s], shape (K,).
        mode: Name of the planner's mode at each sample, length K.
        gripper_position: Joint angles [rad], shape (K, n).
        gripper_joints: Their n names.
        closure: Commanded closure, 0 open .. 1 closed, shape (K,).
        proximity: Finger sensors' distances [m], shape (K, m); inf sees nothing.
        sensors: Their m names.
        arm_velocity: Joint speeds [rad/s], shape (K, N).
        arm_slides: Whether these joints are prismatic, their speeds in m/s.
        object_height: Height of the picked object's centre [m], shape (K,).
        title: Written above.
    """

    time: Vector
    mode: Sequence[str] = ()
    gripper_position: Vector | None = None
    gripper_joints: Sequence[str] = ()
    closure: Vector | None = None
    proximity: Vector | None = None
    sensors: Sequence[str] = ()
    arm_velocity: Vector | None = None
    arm_slides: bool = False
    object_height: Vector | None = None
    title: str = ""


def draw_timeline(timeline: Timeline, path: Path | str) -> Path:
    """Draw a timeline into a PNG file; no display is needed.

    Returns:
        The path.

    Raises:
        ImportError: If matplotlib is missing.
        OSError: If the file cannot be written.
        ValueError: If a series has another length than `time`, or there is none.
    """
    panels = _panels(timeline)
    figure = make_figure(11, 0.9 + 1.55 * len(panels), timeline.title)
    all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (label, values, names) in zip(all_axes, panels, strict=True):
        _draw_panel(axes, timeline.time, label, values, names)
    _draw_modes(all_axes, timeline.time, timeline.mode)
    figure.align_ylabels(all_axes)
    all_axes[-1].set_xlabel("simulated time [s]")
    if len(timeline.time) > 1:
        all_axes[-1].set_xlim(timeline.time[0], timeline.time[-1])
    return save_png(figure, path)


def _panels(timeline: Timeline) -> list[tuple[str, Vector, Sequence[str]]]:
    """Label, values (K, n) and names of each panel."""
    arm = timeline.arm_velocity
    arm_names = [f"{i + 1}" for i in range(0 if arm is None else np.shape(arm)[1])]
    series: list[tuple[str, Vector | None, float, Sequence[str]]] = [
        (
            "fingers [deg]",
            timeline.gripper_position,
            180 / np.pi,
            timeline.gripper_joints,
        ),
        ("closure\ncommanded", timeline.closure, 1.0, ()),
        ("proximity [mm]", timeline.proximity, 1e3, timeline.sensors),
        ("arm speed\n[mm/s]", arm, 1e3, arm_names)
        if timeline.arm_slides
        else ("arm speed\n[deg/s]", arm, 180 / np.pi, arm_names),
        ("object height\n[mm]", timeline.object_height, 1e3, ()),
    ]
    count = len(timeline.time)
    panels = []
    for label, given, unit, names in series:
        if given is None:
            continue
        values = unit * np.asarray(given, dtype=float).reshape(len(given), -1)
        if len(values) != count:
            raise ValueError(
                f"Timeline: {label.split()[0]} has {len(values)} samples, time {count}"
            )
        panels.append((label, values, names))
    if timeline.mode and len(timeline.mode) != count:
        raise ValueError(f"Timeline: mode has {len(timeline.mode)}, time {count}")
    if not panels:
        raise ValueError("Timeline: there is nothing to draw besides time and mode")
    return panels


def _draw_panel(
    axes: Any,
    time: Vector,
    label: str,
    values: Vector,
    names: Sequence[str],
) -> None:
    style_axes(axes, ylabel=label)
    shown = np.where(np.isfinite(values), values, np.nan)
    for i in range(values.shape[1]):
        name = names[i] if i < len(names) else None
        axes.plot(time, shown[:, i], lw=1.2, label=name)
    axes.margins(y=0.12)
    if names:
        axes.legend(
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            fontsize=8,
            frameon=False,
            handlelength=1.2,
        )


def _draw_modes(all_axes: npt.NDArray[Any], time: Vector, mode: Sequence[str]) -> None:
    """Shades the background by mode and names the modes above the first panel."""
    if not len(mode):
        return
    changes = [i for i in range(1, len(mode)) if mode[i] != mode[i - 1]]
    edges = [0, *changes, len(mode) - 1]
    gap = 0.018 * (time[-1] - time[0])  # between labels of modes that pass quickly
    place = time[0] - gap
    for k, (first, last) in enumerate(itertools.pairwise(edges)):
        for axes in all_axes:
            axes.axvspan(time[first], time[last], color=_BANDS[k % 2], lw=0, zorder=-1)
        place = max(time[first], place + gap)
        all_axes[0].annotate(
            mode[first].replace("_", " "),
            (place, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(2, 3),
            textcoords="offset points",
            fontsize=8,
            rotation=45,
            rotation_mode="anchor",
        )
