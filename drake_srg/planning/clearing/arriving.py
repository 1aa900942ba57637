"""Counts the loads that arrive where they belong, and those that do not."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from drake_srg.planning.clearing.clearing_memory import ClearingMemory
from drake_srg.planning.clearing.clearing_motions import HAND_RADIUS
from drake_srg.planning.clearing.destination import Destination
from drake_srg.planning.clearing.loads import Drop, Received
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
    seen = seen.completed(before)
    looks = memory.looks + 1
    memory = dc.replace(memory, destinations=seen, drop=None, looks=looks)
    if before is None or drop is None:
        return memory
    risen = Risen.between(drop.destination, before, seen)
    memory = _without_what_left(memory, drop.destination, risen.lost)
    load = risen.without_settled(drop.load)
    if risen.shows(load):
        several = memory.multi_object_picks + risen.shows_several(load)
        memory = dc.replace(memory, multi_object_picks=several)
        come = Received(drop.load.volume, before, seen, drop.destination)
        return _arrived(memory, drop, come)
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
    for load in _counted(memory, destination):
        if volume > MAIN_SHARE * load.volume and load.has_left(memory.destinations):
            return _without(memory, load)
    return memory


def match_missed_load(
    memory: ClearingMemory, destination: Destination, volume: float
) -> tuple[ClearingMemory, bool]:
    """Match what has come to lie beside a bin with a load that is missed there.

    Something else may have rolled there, unless a load is missed. One may have left
    the bin unnoticed, as another came in. If that lies where it was, only a thing of
    the same volume is taken for it.

    Args:
        memory: The planner's.
        destination: The bin.
        volume: Of what lay beside it, on the map of the table [m³].

    Returns:
        The memory, in which a load that has left counts no more, and whether a load is
        missed. Without a map of where loads go, one always may be.
    """
    now = memory.destinations
    if now is None or _reports(memory, destination):
        return memory, True
    left = [
        load
        for load in _counted(memory, destination)
        if load.has_left(now) or (load.is_like(volume) and load.may_have_left(now))
    ]
    if not left:
        return memory, False
    return _without(memory, min(left, key=lambda o: abs(o.volume - volume))), True


def _counted(memory: ClearingMemory, destination: Destination) -> list[Received]:
    """Return the loads that count as arrived at a destination."""
    loads = memory.received
    return [o for o in loads if o.counts and o.destination is destination]


def _reports(memory: ClearingMemory, destination: Destination) -> list[Left]:
    """Return the reports of loads that were dropped at a destination."""
    middle = destination.middle
    return [left for left in memory.lost if np.allclose(left.p_W[:2], middle)]


def _without(memory: ClearingMemory, load: Received) -> ClearingMemory:
    """Count a load no more, and report it as dropped."""
    received = tuple(
        dc.replace(other, counts=other.counts and other is not load)
        for other in memory.received
    )
    lost = (*memory.lost, _dropped(load.destination))
    arrived = memory.arrived - 1
    return dc.replace(memory, received=received, lost=lost, arrived=arrived)


def _arrived(memory: ClearingMemory, drop: Drop, come: Received) -> ClearingMemory:
    """Count a load, and miss it no more if it had been dropped."""
    received = (*memory.received, come)
    # At the next grasp, what was taken has changed the table; in the end, pushes have.
    pushed = () if memory.pick else memory.pushed
    memory = dc.replace(memory, pushed=pushed, received=received)
    lost = memory.lost
    if drop.again:  # withdraw one report, of its own bin
        reports = _reports(memory, drop.destination)
        lost = tuple(left for left in lost if left not in reports[-1:])
    return dc.replace(memory, arrived=memory.arrived + 1, lost=lost)


def _lost(memory: ClearingMemory, drop: Drop) -> ClearingMemory:
    """Report a load as dropped once."""
    if drop.again:
        return memory
    return dc.replace(memory, lost=(*memory.lost, _dropped(drop.destination)))


def _dropped(destination: Destination) -> Left:
    return Left(np.array([*destination.middle, 0.0]), Failure.DROPPED)
