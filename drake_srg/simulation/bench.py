"""The gripper's bench: its scenario with other objects, and a shaking motion."""

import copy
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydrake.common.schema import Rotation
from pydrake.math import RollPitchYaw

from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.minimum_jerk import minimum_jerk_blend
from drake_srg.objects.config import ObjectConfig
from drake_srg.planning.planner_machine import PickAndPlace
from drake_srg.scenario import Scenario, load_scenario
from drake_srg.types import Vector


def shake(
    q: npt.ArrayLike, acceleration: npt.ArrayLike, frequency: float, duration: float
) -> Callable[[float], Vector]:
    """Return a shaking motion about an arm position, as a function of time [s].

    The motion swells and fades within two cycles each, so that it starts and ends at
    rest.

    Args:
        q: Middle position of the joints (N) [rad or m].
        acceleration: Acceleration of each joint at its turning points (N) [rad/s² or
            m/s²].
        frequency: Frequency of the sine [Hz].
        duration: Time from rest to rest [s].
    """
    omega = 2.0 * np.pi * frequency
    middle, amplitude = np.asarray(q, float), np.asarray(acceleration, float) / omega**2
    swell = 2.0 / frequency

    def position(t: float) -> Vector:
        envelope = minimum_jerk_blend(t / swell)
        envelope *= minimum_jerk_blend((duration - t) / swell)
        value: Vector = middle + envelope * np.sin(omega * t) * amplitude
        return value

    return position


def bench_scenario(
    thing: ObjectConfig | None = None,
    *,
    gripper_rpy: Sequence[float] | None = None,
    home: Sequence[float] | None = None,
    scenario: str | Path = "gripper_bench",
    seed: int | None = None,
    overrides: Sequence[str] = (),
) -> Scenario:
    """Load a scenario of the gripper's bench with another object or hand pose.

    Args:
        thing: Object that replaces the scenario's own, as `objects.thing`. Unless it
            has a position or pose, it takes the old one's place, under the hand.
        gripper_rpy: Roll, pitch and yaw [degrees] of the palm in the flange's frame,
            which is parallel to world on the gantry: [0, 90, 0] points down, [0, 0, 0]
            to the front.
        home: Joint positions of the arm at the start [rad or m].
        scenario: Name or path of the scenario.
        seed: Replaces `random_seed`.
        overrides: Entries `KEY=VALUE`, as for `load_scenario`.

    Raises:
        ScenarioError: If the scenario or an override is invalid.
    """
    bench = load_scenario(scenario, seed=seed, overrides=overrides)
    if thing is not None:
        thing = copy.deepcopy(thing)
        if thing.position is None and thing.pose is None:
            thing.position = bench.objects[bench.task.pick].position
        bench.objects = {"thing": thing}
        bench.task.pick = "thing"
        bench.task.place.marker = ""  # there is no goal for the new object
    if gripper_rpy is not None:
        welds = [d.add_weld for d in bench.directives if d.add_weld is not None]
        (weld,) = [weld for weld in welds if weld.child == "gripper::palm"]
        weld.X_PC.rotation = Rotation(RollPitchYaw(np.deg2rad(gripper_rpy)))
    if home is not None:
        if bench.arm is None:
            raise ScenarioError(f"{scenario}: home: needs a scenario with an arm")
        bench.arm.home = [float(x) for x in home]
    bench.planner = PickAndPlace()  # the script was for the scenario's own object
    return bench
