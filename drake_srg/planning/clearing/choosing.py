"""Chooses among the things on a table by their labels, and where each goes."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drake_srg.planning.clearing.clearing_memory import ClearingMemory
from drake_srg.planning.clearing.clearing_motions import ClearingMotions
from drake_srg.planning.clearing.destination import Destination
from drake_srg.planning.clearing.picking import PickPlanner
from drake_srg.planning.grasps.candidates import Candidates
from drake_srg.planning.grasps.height_map_grasps import HeightMapGrasps
from drake_srg.planning.grasps.relief import Relief, Thing, sides
from drake_srg.planning.grasps.top_grasp import GraspPlanner, TopGrasp
from drake_srg.planning.planner_machine import PlannerConfig
from drake_srg.types import Failure, HeightMap, LabeledHeightMap, Vector

# Labels are wrong at edges: this share of what is between the fingers must agree.
_LEAST_SHARE = 0.8
_LEAST_HEIGHT = 0.004  # of a thing above the table [m]
# Points between the fingers: along the closing direction, and across it [m].
_ALONG, _ACROSS = np.linspace(0.0, 1.0, 13), np.array([-0.006, 0.0, 0.006])
_PER_GRASP = _ALONG.size * _ACROSS.size
# Cells of a thing that have a label, at least: fewer are at the edge of another thing.
_LEAST_CELLS = 15


def labels_between(
    height_map: HeightMap, table: float, low: Vector, high: Vector
) -> npt.NDArray[np.int8]:
    """Return the label of what is between pads, -1 for none or for several.

    Args:
        height_map: A LabeledHeightMap.
        table: Height of the table [m].
        low: x, y of one pad, shape (n, 2) [m].
        high: Of the other.
    """
    assert isinstance(height_map, LabeledHeightMap), "labels need a ThingLabeler"
    apart = (high - low)[:, None, None]
    along = low[:, None, None] + _ALONG[:, None, None] * apart
    normal = apart[..., ::-1] * [-1.0, 1.0] / np.linalg.norm(apart, axis=-1)[..., None]
    points = (along + _ACROSS[:, None] * normal).reshape(len(low), _PER_GRASP, 2)
    cells = height_map.cells(points)
    iy, ix = np.moveaxis(cells, -1, 0)
    ny, nx = height_map.height.shape
    inside = (iy >= 0) & (ix >= 0) & (iy < ny) & (ix < nx)
    iy, ix = np.where(inside, iy, 0), np.where(inside, ix, 0)
    on = inside & (np.nan_to_num(height_map.height[iy, ix]) > table + _LEAST_HEIGHT)
    found = np.where(on, height_map.label[iy, ix], -1)
    shares = [
        np.count_nonzero(found == i, axis=1) / np.maximum(on.sum(axis=1), 1)
        for i in range(len(height_map.names))
    ]
    best = np.argmax(shares, axis=0)
    clear = np.max(shares, axis=0) >= _LEAST_SHARE
    return np.asarray(np.where(clear, best, -1), np.int8)


def label_of(grasp: TopGrasp, height_map: HeightMap, table: float) -> int:
    """Return the label of what a grasp takes, -1 for none or for several."""
    y_W = grasp.X_WG.rotation().matrix()[:2, 1]
    reach = 0.5 * grasp.width * y_W
    low, high = (grasp.p_WC[:2] + side * reach for side in (-1.0, 1.0))
    return int(labels_between(height_map, table, low[None], high[None])[0])


class ChosenGrasps(HeightMapGrasps):
    """Finds grasps of labelled things only; everything else is in the way.

    Its maps are LabeledHeightMaps. For its arguments see `TopGraspSearch`.
    """

    def relief(self, height_map: HeightMap) -> Relief:
        """Return what stands on the table, its labelled parts as things."""
        relief = super().relief(height_map)
        assert isinstance(height_map, LabeledHeightMap), "labels need a ThingLabeler"
        parts = []
        for thing in relief.things:
            labelled = height_map.label[thing.cells[:, 0], thing.cells[:, 1]] >= 0
            if np.count_nonzero(labelled) >= _LEAST_CELLS:
                parts.append(_part(relief, thing, thing.cells[labelled]))
        return dc.replace(relief, things=tuple(parts))

    def allowed(self, relief: Relief, candidates: Candidates) -> Candidates:
        """Return the candidates that take one labelled thing."""
        low, high = (
            candidates.p_W + side[:, None] * candidates.direction
            for side in (candidates.low, candidates.high)
        )
        label = labels_between(relief.map, self._table, low, high)
        return candidates.take(np.flatnonzero(label >= 0))


def _part(relief: Relief, thing: Thing, cells: npt.NDArray[np.intp]) -> Thing:
    """Return the part of a thing that consists of some of its cells."""
    heights = relief.above[cells[:, 0], cells[:, 1]].astype(float)
    points = relief.map.middles()[cells[:, 0], cells[:, 1]]
    middle = np.average(points, axis=0, weights=heights)
    size = sides(cells, relief.map.resolution)
    top = float(heights.max())
    return dc.replace(thing, cells=cells, middle=middle, size=size, top=top)


class ChoosingPlanner(PickPlanner):
    """Plans the next pick among labelled things, and carries each to its own place.

    Args:
        grasps: Finds grasps of labelled things.
        motions: For each label, motions to its place.
        names: The labels.
        required: Which labels are names of objects. One that is neither seen nor taken
            when the planner is done makes the task fail.
        table: Height of the table [m].
        config: Attempts and latency.
        q_aside: See `PickPlanner`.
    """

    def __init__(
        self,
        grasps: GraspPlanner,
        motions: Sequence[ClearingMotions],
        names: Sequence[str],
        required: Sequence[bool],
        table: float,
        config: PlannerConfig,
        q_aside: Vector | None = None,
    ) -> None:
        super().__init__(grasps, motions[0], config, q_aside=q_aside)
        self._by_label, self._table = tuple(motions), table
        self._names, self._required = tuple(names), tuple(required)

    @property
    def destinations(self) -> tuple[Destination, ...]:
        """Where loads of all labels go."""
        return tuple(motions.destination for motions in self._by_label)

    def motions_with(
        self, grasp: TopGrasp, height_map: HeightMap
    ) -> ClearingMotions | None:
        """Return the motions to the place of what a grasp takes, None without one."""
        label = label_of(grasp, height_map, self._table)
        return None if label < 0 else self._by_label[label]

    def judge(self, memory: ClearingMemory, height_map: HeightMap) -> ClearingMemory:
        """Judge the pick under way, and remember the label of what it took."""
        pick, before = memory.planned, memory.taken
        memory = super().judge(memory, height_map)
        if memory.taken == before:
            return memory
        label = label_of(pick.grasp, pick.height_map, self._table)
        return dc.replace(memory, labels=memory.labels | {label})

    def plan(
        self, memory: ClearingMemory, height_map: HeightMap, time: float
    ) -> ClearingMemory:
        """Plan the next pick; fail if what should be taken has never been seen."""
        memory = super().plan(memory, height_map, time)
        if not memory.finished:
            return memory
        assert isinstance(height_map, LabeledHeightMap)
        seen = memory.labels | set(np.unique(height_map.label).tolist())
        missing = [
            name
            for i, (name, required) in enumerate(
                zip(self._names, self._required, strict=True)
            )
            if required and i not in seen
        ]
        if missing or not seen - {-1}:
            what = ", ".join(missing or self._names)
            message = f"the cameras see no {what} on the table"
            return dc.replace(memory, failure=Failure.NOT_SEEN, message=message)
        return memory
