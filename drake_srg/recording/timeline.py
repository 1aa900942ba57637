"""The timeline of a run as a figure, and the style of all our figures."""

from __future__ import annotations

import dataclasses as dc
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from drake_srg.common.log_format import logged_modes, pose_key
from drake_srg.recording.output import OutputFile, require
from drake_srg.types import Mode, Vector

# Colours that colour-blind readers can distinguish (M. Okabe, K. Ito, Color Universal
# Design).
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#333333")


def make_figure(
    width: float, height: float, title: str = "", *, layout: str | None = "constrained"
) -> Any:
    """Return an empty matplotlib Figure; it needs no display.

    Args:
        width: [inch].
        height: [inch].
        title: Text above the axes, on the left.
        layout: Layout engine of matplotlib; None for axes that are placed by hand.

    Raises:
        ImportError: If matplotlib is missing.
    """
    require("matplotlib.backends.backend_agg")
    figure = require("matplotlib.figure").Figure(
        figsize=(width, height), dpi=110, layout=layout
    )
    if title:
        figure.suptitle(title, x=0.01, ha="left", weight="bold")
    return figure


def style_axes(axes: Any, *, xlabel: str = "", ylabel: str = "") -> None:
    """Give axes our style and labels; call this before plotting and drawing legends."""
    axes.set_prop_cycle(color=COLORS)
    axes.set_xlabel(xlabel, fontsize=9)
    axes.set_ylabel(ylabel, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(axis="y", color="#c8ced6", lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)


def save_png(figure: Any, path: Path | str) -> Path:
    """Write a figure, completely or not at all; equal figures give equal bytes.

    Raises:
        OSError: If the file cannot be written.
    """
    output = OutputFile(path)
    # matplotlib would write its version into the file.
    figure.savefig(output.path, format="png", metadata={"Software": None})
    return output.commit()


_BANDS = ("#eef2f6", "#dbe4ed")
# Sizes of the figure, its margins and a panel [inch].
_WIDTH, _PANEL = 11.0, 1.55
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.85, 1.15, 1.0, 0.55
_LABEL = -0.045  # place of the labels on the left, as a share of a panel's width


# Label, values (K, n), and names of the lines.
Panel: TypeAlias = tuple[str, Vector, Sequence[str]]


@dc.dataclass(frozen=True)
class Timeline:
    """The data of a timeline; a series that is None has no panel.

    Attributes:
        time: Sample times [s], shape (K,).
        mode: Name of the planner's mode at each sample, length K.
        gripper_position: Gripper joint angles [rad], shape (K, n).
        gripper_joints: Names of the n joints.
        closure: Commanded closure, 0 open .. 1 closed, shape (K,).
        proximity: Finger sensors' distances [m], shape (K, m); inf: nothing in range.
        sensors: Names of the m sensors.
        grip_force: Largest contact force on the picked object [N], shape (K,).
        arm_velocity: Arm joint velocities [rad/s], shape (K, N).
        arm_torque: Arm joint torques [N m], shape (K, N).
        arm_slides: Whether the arm's joints are prismatic, with velocities in m/s and
            forces in N.
        object_height: Height of the picked object's centre [m], shape (K,).
        signals: Further panels, as from `timeline_panels`.
        title: Text above the panels.
    """

    time: Vector
    mode: Sequence[str] = ()
    gripper_position: Vector | None = None
    gripper_joints: Sequence[str] = ()
    closure: Vector | None = None
    proximity: Vector | None = None
    sensors: Sequence[str] = ()
    grip_force: Vector | None = None
    arm_velocity: Vector | None = None
    arm_torque: Vector | None = None
    arm_slides: bool = False
    object_height: Vector | None = None
    signals: Sequence[Panel] = ()
    title: str = ""


def draw_timeline(timeline: Timeline, path: Path | str) -> Path:
    """Draw a timeline into a PNG file; this needs no display.

    Returns:
        The path.

    Raises:
        ImportError: If matplotlib is missing.
        OSError: If the file cannot be written.
        ValueError: If a series and `time` differ in length, or there are no series.
    """
    panels = timeline_panels(timeline)
    # Placed by hand: a layout engine takes as long as drawing.
    height = _TOP + _PANEL * len(panels) + _BOTTOM
    figure = make_figure(_WIDTH, height, timeline.title, layout=None)
    all_axes = figure.subplots(
        len(panels),
        1,
        sharex=True,
        squeeze=False,
        gridspec_kw={
            "left": _LEFT / _WIDTH,
            "right": 1.0 - _RIGHT / _WIDTH,
            "bottom": _BOTTOM / height,
            "top": 1.0 - _TOP / height,
            "hspace": 0.1,
        },
    )[:, 0]
    for axes, (label, values, names) in zip(all_axes, panels, strict=True):
        _draw_panel(axes, timeline.time, label, values, names)
    _draw_modes(all_axes, timeline.time, timeline.mode)
    for axes in all_axes:
        axes.yaxis.set_label_coords(_LABEL, 0.5)
    for axes in all_axes[:-1]:
        axes.xaxis.set_visible(False)  # its ticks take a tenth of the drawing
    all_axes[-1].set_xlabel("simulated time [s]")
    if len(timeline.time) > 1:
        all_axes[-1].set_xlim(timeline.time[0], timeline.time[-1])
    return save_png(figure, path)


def timeline_panels(timeline: Timeline) -> list[Panel]:
    """Return label, values (K, n) and names of the lines for each panel.

    Raises:
        ValueError: If a series and `time` differ in length, or there are no series.
    """
    panels = _panels(timeline)
    count = len(timeline.time)
    if timeline.mode and len(timeline.mode) != count:
        raise ValueError(
            f"Timeline: mode needs {count} samples like time, got {len(timeline.mode)}"
        )
    if not panels:
        raise ValueError("Timeline: needs at least one series besides time and mode")
    return panels


def _panels(timeline: Timeline) -> list[Panel]:
    arm = (timeline.arm_velocity, timeline.arm_torque)
    joints = max(0 if one is None else np.shape(one)[1] for one in arm)
    arm_names = [f"joint {i + 1}" for i in range(joints)]
    degrees = 180 / np.pi
    # Field, label, factor from SI, names of the lines.
    series: list[tuple[str, str, float, Sequence[str]]] = [
        ("gripper_position", "finger joints\n[deg]", degrees, timeline.gripper_joints),
        ("closure", "commanded\nclosure", 1.0, ()),
        ("proximity", "proximity\n[mm]", 1e3, timeline.sensors),
        ("grip_force", "grip force\n[N]", 1.0, ()),
        *(
            (
                ("arm_velocity", "arm velocity\n[mm/s]", 1e3, arm_names),
                ("arm_torque", "arm force\n[N]", 1.0, arm_names),
            )
            if timeline.arm_slides
            else (
                ("arm_velocity", "arm velocity\n[deg/s]", degrees, arm_names),
                ("arm_torque", "arm torque\n[N m]", 1.0, arm_names),
            )
        ),
        ("object_height", "object height\n[mm]", 1e3, ()),
    ]
    count = len(timeline.time)
    panels = list(timeline.signals)
    for field, label, unit, names in series:
        given = getattr(timeline, field)
        if given is None:
            continue
        values = unit * np.asarray(given, dtype=float).reshape(len(given), -1)
        if len(values) != count:
            raise ValueError(
                f"Timeline: {field} needs {count} samples like time, got {len(values)}"
            )
        panels.append((label, values, names))
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


# Largest number of labelled bands: with more, the labels collide.
_MOST_BANDS = 40


def mode_changes(mode: Sequence[str]) -> list[int]:
    """Return the indices of the samples at which a mode begins."""
    return [i for i in range(len(mode)) if i == 0 or mode[i] != mode[i - 1]]


def mode_bands(mode: Sequence[str]) -> list[tuple[int, str]]:
    """Return the first samples of bands over time, and their labels.

    A band is a mode. If there are too many modes to label, it is a cycle: from one
    grasp to the next, or from one return to the first mode to the next.
    """
    changes = mode_changes(mode)
    if len(changes) <= _MOST_BANDS:
        return [(i, mode[i].replace("_", " ")) for i in changes]
    grasp = Mode.PRE_GRASP.value
    first = grasp if grasp in mode else mode[0]
    starts = [i for i in changes if mode[i] == first]
    cycles = [(start, str(number)) for number, start in enumerate(starts, start=1)]
    return cycles if cycles[0][0] == 0 else [(0, ""), *cycles]


def _draw_modes(all_axes: npt.NDArray[Any], time: Vector, mode: Sequence[str]) -> None:
    """Shade the background by mode, and name the modes above the first panel."""
    if not len(mode):
        return
    bands = mode_bands(mode)
    edges = [first for first, _ in bands] + [len(mode) - 1]
    gap = 0.022 * (time[-1] - time[0])  # keeps the labels of short modes apart
    place = time[0] - gap
    spans = list(itertools.pairwise(edges))
    for axes in all_axes:
        for color, own in zip(_BANDS, (spans[::2], spans[1::2]), strict=True):
            axes.broken_barh(
                [(time[first], time[last] - time[first]) for first, last in own],
                (0.0, 1.0),
                transform=axes.get_xaxis_transform(),
                color=color,
                lw=0,
                zorder=-1,
            )
    for first, label in bands:
        place = max(time[first], place + gap)
        all_axes[0].annotate(
            label,
            (place, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(2, 3),
            textcoords="offset points",
            fontsize=8,
            rotation=45,
            rotation_mode="anchor",
        )


@dc.dataclass(frozen=True)
class ArmLabels:
    """Labels of the columns of one of several arms.

    Attributes:
        name: Name of the arm.
        gripper_joints: Names of the gripper's measured joints.
        sensors: Names of the finger sensors.
        arm_slides: Whether the arm's joints are prismatic.
    """

    name: str
    gripper_joints: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    arm_slides: bool = False


@dc.dataclass(frozen=True)
class Labels:
    """Labels of a log's columns.

    Attributes:
        title: Title of the run.
        signals: Names of the columns to show, for a log that is not a cell's.
        pick: Name of the picked object.
        gripper_joints: Names of the gripper's measured joints.
        sensors: Names of the finger sensors.
        arm_slides: Whether the arm's joints are prismatic.
        arms: Labels of several arms, which replace the previous three.
    """

    title: str
    pick: str = ""
    gripper_joints: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    arm_slides: bool = False
    signals: tuple[str, ...] = ()
    arms: tuple[ArmLabels, ...] = ()

    def tree(self) -> dict[str, Any]:
        """Return the tree for `of_tree`, in JSON's types."""
        tree = dc.asdict(self)
        if not self.arms:
            del tree["arms"]
        return tree

    @classmethod
    def of_tree(cls, tree: Mapping[str, Any]) -> Labels:
        """Return the labels of a tree.

        Raises:
            TypeError: If it has other entries than labels.
        """
        arms = tuple(ArmLabels(**arm) for arm in tree.get("arms", ()))
        return cls(**{**tree, "arms": arms})


def run_timeline(log: Mapping[str, npt.NDArray[Any]], labels: Labels) -> Timeline:
    """Return the timeline of a log that `Simulate` or `AddRecording` wrote."""
    if labels.signals:
        return _signal_timeline(log, labels)
    poses = log.get(pose_key(labels.pick))
    whole = Timeline(
        time=log["time"],
        mode=logged_modes(log),
        grip_force=log.get("contact_force"),
        object_height=None if poses is None else poses[:, 2],
        title=labels.title,
    )
    if not labels.arms:
        return _with_arm(whole, log, labels, "arm", "gripper")
    panels: list[Panel] = []
    for arm in labels.arms:
        own = Timeline(time=log["time"])
        own = _with_arm(own, log, arm, arm.name, f"{arm.name}.gripper")
        for label, values, names in _panels(own):
            panels.append((f"{arm.name} {label}", values, names))
    return dc.replace(whole, signals=panels)


def _with_arm(
    timeline: Timeline,
    log: Mapping[str, npt.NDArray[Any]],
    labels: Labels | ArmLabels,
    arm_ports: str,
    gripper_ports: str,
) -> Timeline:
    """Return a timeline with the series of an arm and its gripper."""
    arm = log.get(f"{arm_ports}.state_measured")
    gripper = log.get(f"{gripper_ports}.state_measured")
    return dc.replace(
        timeline,
        gripper_position=(
            None if gripper is None else gripper[:, : len(labels.gripper_joints)]
        ),
        gripper_joints=[
            _words(n.removesuffix("_joint")) for n in labels.gripper_joints
        ],
        closure=log.get(f"{gripper_ports}.closure_commanded"),
        proximity=log.get(f"{gripper_ports}.proximity"),
        sensors=[_words(name) for name in labels.sensors],
        arm_velocity=None if arm is None else arm[:, arm.shape[1] // 2 :],
        arm_torque=log.get(f"{arm_ports}.torque_measured"),
        arm_slides=labels.arm_slides,
    )


def _signal_timeline(log: Mapping[str, npt.NDArray[Any]], labels: Labels) -> Timeline:
    """Return the timeline of named signals.

    The first column of strings is the mode. Each other column of strings has a panel
    with its values over time; so does the first one if it is the only column.
    """
    texts = [name for name in labels.signals if log[name].dtype.kind == "U"]
    panels: list[Panel] = []
    for name in labels.signals:
        values = log[name]
        if name not in texts:
            rows = values.reshape(len(values), -1)
            lines = [str(i) for i in range(rows.shape[1])] if rows.shape[1] > 1 else []
            panels.append((name.replace(" [", "\n["), rows, lines))
        elif name != texts[0] or len(labels.signals) == 1:
            words = list(dict.fromkeys(str(value) for value in values))
            panels.append((name, (values[:, None] == words).astype(float), words))
    return Timeline(
        time=log["time"],
        mode=[str(value) for value in log[texts[0]]] if texts else (),
        signals=panels,
        title=labels.title,
    )


def _words(name: str) -> str:
    return name.replace("_", " ")
