"""The station with the interface of the hardware, and the cell around it.

A station is a plant with its sensors and drivers. A cell is a station with a localizer
and a planner, which works autonomously.
"""

from drake_srg.station.cell import (
    AddCell,
    AddDisturber,
    ConnectClearingPlanner,
    ConnectCommands,
    ConnectPlanner,
    MakeCell,
    register_planner,
)
from drake_srg.station.clearing import MakeClearingPlanner
from drake_srg.station.perception import AddDestinationMapper, AddHeightMapper
from drake_srg.station.planners import (
    MakeHand,
    MakePlanner,
    MakeScriptedPlanner,
    MakeTaskPlanner,
    MakeTaughtPlanner,
    register_gripper,
)
from drake_srg.station.station import AddStation, MakeStation

__all__ = [
    "AddCell",
    "AddDestinationMapper",
    "AddDisturber",
    "AddHeightMapper",
    "AddStation",
    "ConnectClearingPlanner",
    "ConnectCommands",
    "ConnectPlanner",
    "MakeCell",
    "MakeClearingPlanner",
    "MakeHand",
    "MakePlanner",
    "MakeScriptedPlanner",
    "MakeStation",
    "MakeTaskPlanner",
    "MakeTaughtPlanner",
    "register_gripper",
    "register_planner",
]
