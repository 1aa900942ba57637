"""Counts the loads that arrive where they belong, and those that do not."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.planning.clearing.clearing_memory import ClearingMemory, Drop, Received
from drake_srg.planning.clearing.clearing_motions import HAND_RADIUS
from drake_srg.planning.clearing.receiving import has_missed, has_received
from drake_srg.types import Failure, HeightMap, Left


def look_for_load(memory: ClearingMemory, seen: HeightMap | None) -> ClearingMemory:
    """Judge by a map of where loads go whether the last one has come there.

    A load that is not seen there does not count. One that fell out counts once.

    Args:
        memory: The planner's.
        seen: The map; None without a camera for it.
    """
    if seen is None:
        return memory
    before, drop = memory.destinations, memory.drop
    if memory.pick is not None and drop is not None:
        # The hand, at the next grasp, is no load beside the bin.
        p_WC = memory.pick.grasp.p_WC[:2]
        hand = np.linalg.norm(seen.middles() - p_WC, axis=-1) < HAND_RADIUS
        hand &= ~drop.destination.contains(seen)
        seen = dc.replace(seen, height=np.where(hand, np.nan, seen.height))
    seen = seen.completed(before)
    looks = memory.looks + 1
    memory = dc.replace(memory, destinations=seen, drop=None, looks=looks)
    if before is None or drop is None:
        return memory
    if has_received(drop.destination, before, seen, drop.load):
        return _arrived(memory, drop, Received(drop.load.volume, before, seen))
    if drop.load.felt or has_missed(drop.destination, before, seen, drop.load):
        return _lost(memory, drop)
    return memory


def _arrived(memory: ClearingMemory, drop: Drop, come: Received) -> ClearingMemory:
    """Count a load, unless it has fallen out and counts already."""
    received = (*memory.received, come)
    memory = dc.replace(memory, pushes=0, received=received)
    if drop.again and not memory.lost:
        return memory
    lost = memory.lost[:-1] if drop.again else memory.lost
    return dc.replace(memory, arrived=memory.arrived + 1, lost=lost)


def _lost(memory: ClearingMemory, drop: Drop) -> ClearingMemory:
    """Report a load as dropped once. If it had counted before, count it no more."""
    if drop.again and memory.lost:
        return memory
    place = np.array([*drop.destination.middle, 0.0])
    lost = (*memory.lost, Left(place, Failure.DROPPED))
    return dc.replace(memory, arrived=memory.arrived - drop.again, lost=lost)
