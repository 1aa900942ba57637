"""Counts the loads that arrive where they belong, and those that do not."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.planning.clearing.clearing_memory import ClearingMemory, Drop, Received
from drake_srg.planning.clearing.clearing_motions import HAND_RADIUS
from drake_srg.planning.clearing.comparing import completed
from drake_srg.planning.clearing.destination import Destination
from drake_srg.planning.clearing.receiving import MAIN_SHARE, Risen
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
    seen = completed(seen, before)
    looks = memory.looks + 1
    memory = dc.replace(memory, destinations=seen, drop=None, looks=looks)
    if before is None or drop is None:
        return memory
    risen = Risen.between(drop.destination, before, seen)
    memory = _without_what_left(memory, drop.destination, risen.lost)
    load = risen.alone(drop.load)
    if risen.shows(load):
        several = memory.multi_object_picks + risen.shows_several(load)
        memory = dc.replace(memory, multi_object_picks=several)
        return _arrived(memory, drop, Received(load.volume, before, seen))
    if load.felt or risen.shows_beside(load):
        return _lost(memory, drop)
    return memory


def _without_what_left(
    memory: ClearingMemory, destination: Destination, volume: float
) -> ClearingMemory:
    """Count a load no more that has left the bin, such as a mug on the open fingers.

    What only topples, or comes to lie elsewhere in the bin, takes up as much there.

    Args:
        memory: The planner's, with the latest map of where loads go.
        destination: The bin.
        volume: By how much less is in it than on the map before [m³].
    """
    for load in memory.received:
        if volume > MAIN_SHARE * load.volume and _gone(memory, load):
            return _without(memory, load, destination)
    return memory


def found_again(
    memory: ClearingMemory, destination: Destination
) -> tuple[ClearingMemory, bool]:
    """Return whether what has come to lie beside a bin may be a load, and count it so.

    Something else may have rolled there, unless a load is missed. One may have left
    the bin unnoticed, as a larger one came in.

    Args:
        memory: The planner's.
        destination: The bin.
    """
    if memory.destinations is None or memory.lost:
        return memory, True
    for load in memory.received:
        if _gone(memory, load):
            return _without(memory, load, destination), True
    return memory, False


def _gone(memory: ClearingMemory, load: Received) -> bool:
    """Return whether a load that counts is no more where it came to lie."""
    return load.counts and load.has_left(memory.destinations)


def _without(
    memory: ClearingMemory, load: Received, destination: Destination
) -> ClearingMemory:
    """Count a load no more, and report it as dropped."""
    received = tuple(
        dc.replace(other, counts=other.counts and other is not load)
        for other in memory.received
    )
    lost = (*memory.lost, _dropped(destination))
    arrived = memory.arrived - 1
    return dc.replace(memory, received=received, lost=lost, arrived=arrived)


def _arrived(memory: ClearingMemory, drop: Drop, come: Received) -> ClearingMemory:
    """Count a load, and miss it no more if it had been dropped."""
    received = (*memory.received, come)
    memory = dc.replace(memory, pushes=0, received=received)
    lost = memory.lost[:-1] if drop.again else memory.lost
    return dc.replace(memory, arrived=memory.arrived + 1, lost=lost)


def _lost(memory: ClearingMemory, drop: Drop) -> ClearingMemory:
    """Report a load as dropped once."""
    if drop.again:
        return memory
    return dc.replace(memory, lost=(*memory.lost, _dropped(drop.destination)))


def _dropped(destination: Destination) -> Left:
    return Left(np.array([*destination.middle, 0.0]), Failure.DROPPED)
