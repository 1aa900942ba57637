"""The timeline of a run as a figure, and the style of all figures."""

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
        width: Width [inch].
        height: Height [inch].
        title: Text above the axes, on the left.
        layout: Layout engine of matplotlib; None for axes that are placed by hand.
    """
    require("matplotlib.backends.backend_agg")
    figure = require("matplotlib.figure").Figure(
        figsize=(width, height), dpi=110, layout=layout
    )
    if title:
        figure.suptitle(title, x=0.01, ha="left", weight="bold")
    return figure


def style_axes(axes: Any, *, xlabel: str = "", ylabel: str = "") -> None:
    """Style and label axes; call this before plotting and drawing legends."""
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
_DEGREES = 180.0 / np.pi  # per radian
_LABEL = -0.045  # x of the labels on the left, as a share of a panel's width


# Label, values (K, n), and names of the n lines, or none.
Panel: TypeAlias = tuple[str, Vector, Sequence[str]]


@dc.dataclass(frozen=True)
class Timeline:
    """The data of a timeline.

    Attributes:
        time: Sample times [s], shape (K,).
        panels: The plots, at least one.
        mode: Name of the planner's mode at each sample, length K; empty: unknown.
        title: Text above the panels.

    Raises:
        ValueError: If a series and `time` differ in length, or there is no panel.
    """

    time: Vector
    panels: Sequence[Panel]
    mode: Sequence[str] = ()
    title: str = ""

    def __post_init__(self) -> None:
        lengths = {label: len(values) for label, values, _ in self.panels}
        if self.mode:
            lengths["mode"] = len(self.mode)
        for label, length in lengths.items():
            if length != len(self.time):
                name = label.replace("\n", " ")
                raise ValueError(
                    f"Timeline: {name} needs {len(self.time)} samples like time, got "
                    f"{length}"
                )
        if not self.panels:
            raise ValueError(
                "Timeline: needs at least one series besides time and mode"
            )


def draw_timeline(timeline: Timeline, path: Path | str) -> Path:
    """Draw a timeline into a PNG file, without a display.

    Returns:
        The path.

    Raises:
        OSError: If the file cannot be written.
    """
    panels = timeline.panels
    # No layout engine, because it takes as long as drawing.
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
        axes.xaxis.set_visible(False)  # ticks take a tenth of the drawing time
    all_axes[-1].set_xlabel("simulated time [s]")
    if len(timeline.time) > 1:
        all_axes[-1].set_xlim(timeline.time[0], timeline.time[-1])
    return save_png(figure, path)


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


# Largest number of labelled bands. Labels of more would overlap.
_MOST_BANDS = 40


def mode_changes(mode: Sequence[str]) -> list[int]:
    """Return the indices of the samples at which a mode begins."""
    return [i for i in range(len(mode)) if i == 0 or mode[i] != mode[i - 1]]


def mode_bands(mode: Sequence[str]) -> list[tuple[int, str]]:
    """Return the first samples of bands over time, and their labels.

    A band is a mode. If there are too many modes to label, a band is a cycle: it begins
    with each grasp or, if there are no grasps, with each return to the first mode.
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
    """Labels of the columns of an arm, in a log with several arms.

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
        pick: Name of the picked object.
        gripper_joints: Names of the gripper's measured joints.
        sensors: Names of the finger sensors.
        arm_slides: Whether the arm's joints are prismatic.
        signals: Names of the columns to show, for a log that is not a cell's.
        arms: Labels of several arms; they replace `gripper_joints`, `sensors` and
            `arm_slides`.
    """

    title: str
    pick: str = ""
    gripper_joints: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    arm_slides: bool = False
    signals: tuple[str, ...] = ()
    arms: tuple[ArmLabels, ...] = ()

    def tree(self) -> dict[str, Any]:
        """Return the labels as a tree of JSON types, for `of_tree`."""
        tree = dc.asdict(self)
        if not self.arms:
            del tree["arms"]
        return tree

    @classmethod
    def of_tree(cls, tree: Mapping[str, Any]) -> Labels:
        """Return the labels of a tree.

        Raises:
            TypeError: If an entry of the tree is unknown or missing.
        """
        arms = tuple(ArmLabels(**arm) for arm in tree.get("arms", ()))
        return cls(**{**tree, "arms": arms})


def run_timeline(log: Mapping[str, npt.NDArray[Any]], labels: Labels) -> Timeline:
    """Return the timeline of a log that `Simulate` or `AddRecording` wrote.

    Quantities that the log lacks have no panels.

    Raises:
        KeyError: If the log lacks time or mode.
        ValueError: If the log has no quantities to plot.
    """
    if labels.signals:
        return _signal_timeline(log, labels)
    force = _panel("grip force\n[N]", log.get("contact_force"))
    poses = log.get(pose_key(labels.pick))
    height = _panel("object height\n[mm]", None if poses is None else poses[:, 2], 1e3)
    if labels.arms:
        panels = [
            (f"{arm.name} {label}", values, names)
            for arm in labels.arms
            for label, values, names in (
                *_hand_panels(log, arm, f"{arm.name}.gripper"),
                *_arm_panels(log, arm, arm.name),
            )
        ]
        panels += force
    else:
        panels = _hand_panels(log, labels, "gripper") + force
        panels += _arm_panels(log, labels, "arm")
    return Timeline(log["time"], [*panels, *height], logged_modes(log), labels.title)


def _panel(
    label: str,
    values: npt.NDArray[Any] | None,
    factor: float = 1.0,
    names: Sequence[str] = (),
) -> list[Panel]:
    """Return a panel of values times a factor, or no panel without values."""
    if values is None:
        return []
    scaled = factor * np.asarray(values, dtype=float).reshape(len(values), -1)
    return [(label, scaled, names)]


def _hand_panels(
    log: Mapping[str, npt.NDArray[Any]], labels: Labels | ArmLabels, ports: str
) -> list[Panel]:
    """Return the panels of a gripper whose ports have a prefix."""
    joints = [_words(n.removesuffix("_joint")) for n in labels.gripper_joints]
    state = log.get(f"{ports}.state_measured")
    angles = None if state is None else state[:, : len(joints)]
    sensors = [_words(name) for name in labels.sensors]
    return [
        *_panel("finger joints\n[deg]", angles, _DEGREES, joints),
        *_panel("commanded\nclosure", log.get(f"{ports}.closure_commanded")),
        *_panel("proximity\n[mm]", log.get(f"{ports}.proximity"), 1e3, sensors),
    ]


def _arm_panels(
    log: Mapping[str, npt.NDArray[Any]], labels: Labels | ArmLabels, ports: str
) -> list[Panel]:
    """Return the panels of an arm whose ports have a prefix."""
    state, torque = (
        log.get(f"{ports}.{name}") for name in ("state_measured", "torque_measured")
    )
    velocity = None if state is None else state[:, state.shape[1] // 2 :]
    count = max(0 if x is None else x.shape[1] for x in (velocity, torque))
    joints = [f"joint {i + 1}" for i in range(count)]
    if labels.arm_slides:
        velocities = _panel("arm velocity\n[mm/s]", velocity, 1e3, joints)
        return velocities + _panel("arm force\n[N]", torque, 1.0, joints)
    velocities = _panel("arm velocity\n[deg/s]", velocity, _DEGREES, joints)
    return velocities + _panel("arm torque\n[N m]", torque, 1.0, joints)


def _signal_timeline(log: Mapping[str, npt.NDArray[Any]], labels: Labels) -> Timeline:
    """Return the timeline of named signals.

    The first column of strings is the mode. Any other column of strings has a panel
    with a line for each string: 1 where it is the value, else 0. So does the first one
    if there are no other columns.
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
        panels=panels,
        title=labels.title,
    )


def _words(name: str) -> str:
    return name.replace("_", " ")
