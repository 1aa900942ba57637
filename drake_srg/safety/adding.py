"""Add a safety monitor to a diagram."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from drake_srg.safety.config import SafetyConfig
from drake_srg.safety.limits import JointLimits, ToolLimits
from drake_srg.safety.monitor import SafetyMonitor
from drake_srg.safety.tool import Tool
from drake_srg.safety.touch import TouchLimits


def AddSafetyMonitor(
    builder: DiagramBuilder,
    models_plant: MultibodyPlant,
    home: Sequence[float],
    config: SafetyConfig,
    period: float,
    arm: str = "arm",
) -> SafetyMonitor:
    """Add `safety_monitor` to a diagram; its ports are the caller's to connect.

    Args:
        builder: Of the diagram.
        models_plant: A finalized plant with the arm and its hand.
        home: Where the commands begin, shape (N,) [rad or m].
        config: The limits.
        period: Of the arm's driver [s].
        arm: Name of the arm's model instance.

    Raises:
        ValueError: If the limits do not fit the arm, or the tool does not exist.
    """
    instance = models_plant.GetModelInstanceByName(arm)
    limits = JointLimits.of_plant(models_plant, instance, config, period)
    tool = Tool(models_plant, arm, config.tool) if config.needs_tool else None
    monitor = SafetyMonitor(
        np.array(home),
        limits,
        config,
        period,
        ToolLimits.of(config, tool.position, period) if tool else None,
        TouchLimits.of(config, len(home), tool),
    )
    return builder.AddNamedSystem("safety_monitor", monitor)
