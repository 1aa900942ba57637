"""The cell: a station with a localizer and a planner."""

from drake_srg.cell.cell import (
    AddCell,
    AddDisturber,
    ConnectClearingPlanner,
    ConnectCommands,
    ConnectPlanner,
    MakeCell,
    register_planner,
)
from drake_srg.cell.clearing import MakeClearingPlanner
from drake_srg.cell.hands import MakeHand, register_gripper
from drake_srg.cell.height_maps import AddDestinationMapper, AddHeightMapper
from drake_srg.cell.planners import (
    MakePlanner,
    MakeScriptedPlanner,
    MakeTaskPlanner,
    MakeTaughtPlanner,
)

__all__ = [
    "AddCell",
    "AddDestinationMapper",
    "AddDisturber",
    "AddHeightMapper",
    "ConnectClearingPlanner",
    "ConnectCommands",
    "ConnectPlanner",
    "MakeCell",
    "MakeClearingPlanner",
    "MakeHand",
    "MakePlanner",
    "MakeScriptedPlanner",
    "MakeTaskPlanner",
    "MakeTaughtPlanner",
    "register_gripper",
    "register_planner",
]
