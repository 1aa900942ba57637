"""The modes of an insertion: how each pulls on the peg's tip, and when it ends.

The hand yields like a spring, so a set-point away from the measured tip is a force.
In modes in which the peg must be free to move, the set-point follows the smoothed
measurement at the distance that gives this force. A set-point never pulls harder than
the limits of the configuration.
"""

from __future__ import annotations

import abc
import dataclasses as dc
from typing import ClassVar

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from drake_srg.planning.grasps.grasps import pose_along
from drake_srg.planning.insertion.config import (
    Insertion,
    InsertMode,
    Task,
    centred,
    insertion_of,
)
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.knowledge import PlannerMemory
from drake_srg.planning.pick_and_place.modes import (
    Carrying,
    Entry,
    Home,
    Now,
    Release,
    TaskMode,
)
from drake_srg.planning.pick_and_place.replanning import Replanner
from drake_srg.planning.planner_machine import Observation
from drake_srg.planning.servoing.hand_motion import (
    limited,
    rotation_vector,
    turned,
    upright,
)
from drake_srg.types import AnyMode, Failure, Mode, Vector

_UP = np.array([0.0, 0.0, 1.0])
_PROGRESS = 2e-4  # least motion that is progress [m]
_WITHOUT = 0.4  # time without progress after which the peg counts as resting [s]
# The same in the hole [s], where a tight peg creeps until it is upright.
_PATIENCE = 1.5
_LATE = 6.0  # longest duration of a tilt [s]
_DITHER, _FREQUENCY = 6e-4, 3.0  # across the way to the wall [m], [Hz]
# Tilt at which the hand stops when it puts the peg upright [rad]. Between the pads, the
# peg lags by 3 to 7 degrees.
_PAST = -0.035
_TWISTING = 1.0  # period of the turns back and forth [s]
_WOBBLE, _WOBBLING = 0.015, 1.5  # in a circle, of a peg that is pressed [rad], [Hz]
# A leaning peg can wedge down to a depth of friction times diameter (Whitney, 1982).
_WEDGING = 0.35
_FALLEN = 0.0005  # a peg this much deeper than the rim has found the hole [m]
_SINKING = 0.6  # time from then until the edge is at the wall and has sunk [s]
# Longest pressing [s]. Pegs go in within 7 s; later, the hand slips along the peg.
_PRESSING = 10.0
# Force that draws a peg out [N]: at 12 N, the hand slips along a peg that is stuck.
_DRAW = 10.0
# A hand that is felt deeper than the hole has slipped along the peg. While it sinks by
# _SINK [m] in _SINK_TIME [s], the peg may still be sinking, too: along a resting peg,
# hands slip at 0.2 to 1.2 mm/s. At _BELOW the floor, the pressing ends anyway [m].
_SINK, _SINK_TIME, _BELOW = 0.001, 0.5, 0.005
_SHALLOW = 0.003  # depth from which a peg has entered [m]
# The wall is at most this much farther than twice the inset [m]. A peg that slides
# farther has met no hole.
_STRAY = 0.002


class PegMode(TaskMode):
    """A mode that knows the peg and the hole.

    Args:
        task: All that is known.
        replanner: Plans from sightings.
        repeat: Number of the task's cycles.
    """

    def __init__(self, task: Task, replanner: Replanner, repeat: int) -> None:
        super().__init__(task.config, replanner, repeat)
        self.task = task


class Inserting(PegMode, Carrying, abc.ABC):
    """A mode whose set-point follows the motion of the tip.

    Attributes:
        haste: Largest speed of the set-point over `Insert.tip_speed`.
    """

    haste: ClassVar[float] = 1.0

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Begin at the current commands, without a rest between two of these modes."""
        moving = memory.motion
        memory = super().enter(memory, entry)
        memory.motion, tip = moving, insertion_of(memory)
        if entry.previous is Mode.PLACE:
            self._begin(memory, tip)
        self._measure(tip, entry.senses.q, share=1.0)
        tip.began, tip.progress, tip.progress_at = tip.p, -np.inf, entry.time
        tip.twist = np.zeros(3)
        return memory

    def _begin(self, memory: PlannerMemory, tip: Insertion) -> None:
        """Record the hand's hold on the peg, and the expected place of the hole."""
        task, grasp = self.task, memory.attempt.planned.grasp
        tip.q = memory.motion.destination
        tip.v = np.zeros_like(tip.q)
        X_WG = task.arm.X_WG(tip.q)
        up_G = np.copysign(1.0, (X_WG.rotation() @ grasp.axis_G)[2]) * grasp.axis_G
        p_GT = grasp.p_GO - 0.5 * task.peg.height * up_G
        X_GT = pose_along(p_GT, up_G)
        tip.X_TG, tip.X_WT = X_GT.inverse(), X_WG @ X_GT
        pinch = X_WG.rotation().matrix()[:, 1]  # the palm's y
        level = pinch - pinch[2] * _UP
        tip.along = level / np.linalg.norm(level)
        rim = task.X_WO_goal.translation().copy()
        rim[2] += task.config.depth - 0.5 * task.peg.height
        tip.X_WU = RigidTransform(upright(tip.X_WT.rotation()), rim)
        tip.rim, tip.angle = float(rim[2]), 0.0
        tip.tries, tip.stops, tip.deepest, tip.seated = 0, (), 0.0, False

    def _measure(self, tip: Insertion, q: Vector, share: float) -> None:
        assert tip.X_TG is not None, "the first of these modes records the hold"
        tip.X_WT_measured = self.task.arm.X_WG(q) @ tip.X_TG.inverse()
        tip.p = tip.p + share * (tip.X_WT_measured.translation() - tip.p)

    def update(self, memory: PlannerMemory, now: Now) -> PlannerMemory:
        """Move the set-point, unless the hand has lost the peg."""
        # If the hole holds the hand aside, one finger closes farther than the other.
        seen = dc.replace(now.senses, fingers=centred(now.senses.fingers))
        memory = super().update(memory, dc.replace(now, senses=seen))
        config, tip = self.task.config, insertion_of(memory)
        if memory.attempt.lost or memory.trouble.touched:
            return memory
        share = min(config.drift * config.period, 1.0)
        self._measure(tip, now.senses.q, share)
        progress = self.progress(tip)
        if progress > tip.progress + _PROGRESS:
            tip.progress, tip.progress_at = progress, now.time
        R_WT = self.rotation(tip, now.time, share)
        p, most = tip.X_WT.translation(), self.haste * config.tip_speed * config.period
        p = p + limited(self.pull_to(tip, now.time) - p, most)
        self._command(memory, tip, RigidTransform(R_WT, p), now.time)
        return memory

    def _command(
        self, memory: PlannerMemory, tip: Insertion, X_WT: RigidTransform, time: float
    ) -> None:
        """Command a set-point of the tip, reduced to the limits of the pull."""
        config, arm, X_WM = self.task.config, self.task.arm, tip.X_WT_measured
        pull = X_WT.translation() - X_WM.translation()
        turn = rotation_vector(X_WT.rotation() @ X_WM.rotation().inverse())
        p = X_WM.translation() + limited(pull, config.force_limit / config.stiffness)
        most = config.torque_limit / config.turning_stiffness
        tip.X_WT = RigidTransform(turned(X_WM.rotation(), limited(turn, most)), p)
        assert tip.X_TG is not None
        q, v, way = arm.track(tip.q, tip.v, tip.X_WT @ tip.X_TG, config.period)
        memory.motion = Motion(tip.q, way, time, time + config.period)
        tip.q, tip.v = q, v

    def pull_to(self, tip: Insertion, time: float) -> Vector:
        """Return the target of the set-point, shape (3,) [m]."""
        return tip.p

    def turn_to(self, tip: Insertion) -> float:
        """Return the tilt to which the set-point turns [rad]."""
        return tip.angle

    def rotation(self, tip: Insertion, time: float, share: float) -> RotationMatrix:
        """Turn the set-point towards its tilt, and return its orientation R_WT."""
        assert tip.X_WU is not None
        step = self.turn_to(tip) - tip.angle
        most = self.task.config.turning * self.task.config.period
        tip.angle += float(np.clip(step, -most, most))
        return turned(tip.X_WU.rotation(), tip.angle * np.cross(_UP, tip.along))

    def progress(self, tip: Insertion) -> float:
        """Return the mode's progress [m], which is constant while the peg rests."""
        return float(-tip.p[2])

    def stalled(self, tip: Insertion, time: float) -> bool:
        """Return whether the peg has made no progress for some time."""
        return time - tip.progress_at > _WITHOUT

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report that the hand has lost the peg, or how the mode ends."""
        if memory.attempt.lost:
            return Observation(arrived=True)
        seen = self.observe_tip(insertion_of(memory), now.time)
        return dc.replace(seen, holding=True)

    @abc.abstractmethod
    def observe_tip(self, tip: Insertion, time: float) -> Observation:
        """Return the observation for the mode's transitions while the peg is held."""

    def forward(
        self, tip: Insertion, down: float, along: float = 0.0, *, held: bool = False
    ) -> Vector:
        """Return the set-point that pulls the tip down and along, (3,) [m].

        Args:
            tip: The tip.
            down: Force [N].
            along: Force towards the wall [N].
            held: Whether the tip stays sideways at the mode's start; with a force
                along, only across the pinch axis. A peg that turns between the pads
                looks like a moving tip: a set-point that followed would take the hand
                to the side.
        """
        force = along * self.task.wall(tip) - down * _UP
        p, held_along = tip.p.copy(), tip.along * (along == 0.0)
        if held:
            for axis in (np.cross(_UP, tip.along), held_along):
                p += (tip.began - tip.p) @ axis * axis
        return p + force / self.task.config.stiffness


class Tilt(Inserting):
    """Tilts the peg over the hole, one edge of it lower and inside the rim."""

    mode = InsertMode.TILT
    haste = 3.0  # nothing is in its way

    def turn_to(self, tip: Insertion) -> float:
        """Return the tilt to which the set-point turns [rad]."""
        return self.task.tilt

    def pull_to(self, tip: Insertion, time: float) -> Vector:
        """Return the place above the hole, with one edge inside the rim, (3,) [m]."""
        assert tip.X_WU is not None
        config, r = self.task.config, self.task.radius
        aside = r - self.task.inset - r * np.cos(self.task.tilt)
        up = r * np.sin(self.task.tilt) + 0.5 * config.hover
        # Walls lead a round end to the middle, but a square one must be set down there.
        steps = tip.tries // 2 if self.task.round else (tip.tries + 1) // 2
        across = steps * config.search_step * np.cross(_UP, tip.along)
        return tip.X_WU.translation() + aside * tip.along + up * _UP + across

    def observe_tip(self, tip: Insertion, time: float) -> Observation:
        """Report that the peg is in place and tilted, or that something holds it."""
        there = np.linalg.norm(self.pull_to(tip, time) - tip.X_WT.translation()) < 5e-4
        turned = abs(self.turn_to(tip) - tip.angle) < 1e-3
        late = time - tip.progress_at > _LATE
        failure = Failure.STOPPED if late else None
        return Observation(arrived=bool(there and turned), failure=failure)


class Search(Inserting):
    """Lowers the tip until it rests on the rim with one edge in the hole."""

    mode = InsertMode.SEARCH

    def pull_to(self, tip: Insertion, time: float) -> Vector:
        """Return the set-point that pulls the tip straight down, (3,) [m]."""
        down = self.forward(tip, self.task.config.search_force)[2]
        return np.array([*tip.X_WT.translation()[:2], down])

    def observe_tip(self, tip: Insertion, time: float) -> Observation:
        """Report that the tip rests."""
        return Observation(arrived=self.stalled(tip, time))


class Slide(Inserting):
    """Slides the lower edge to the wall of the hole, wiggling across."""

    mode = InsertMode.SLIDE

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Record the rim's height, where the tip's side away from the wall rests.

        The edge in the hole is lower by the chord between the two times the tilt's
        tangent.
        """
        memory = super().enter(memory, entry)
        config, r, tip = self.task.config, self.task.radius, insertion_of(memory)
        edge = tip.p[2] - r * np.sin(config.tilt)
        chord = 2.0 * r - max(self.task.inset, 0.0)
        tip.fallen_at = entry.time
        tip.rim = float(edge + chord * np.tan(config.tilt))
        return memory

    def pull_to(self, tip: Insertion, time: float) -> Vector:
        """Return the set-point that pulls down, to the wall and across, (3,) [m]."""
        wiggle = _DITHER * np.sin(2.0 * np.pi * _FREQUENCY * time)
        across = wiggle * np.cross(_UP, tip.along)
        # As much down as sideways: friction below 1 does not hold the peg.
        force = self.task.config.side_force
        return self.forward(tip, force, force, held=True) + across

    def progress(self, tip: Insertion) -> float:
        """Return the tip's way to the wall [m]."""
        return float((tip.p - tip.began) @ self.task.wall(tip))

    def observe_tip(self, tip: Insertion, time: float) -> Observation:
        """Report that the edge has sunk at the wall, or that there is no hole.

        At the wall, the edge sinks into the hole. The hand may creep on, because the
        peg turns between the pads.
        """
        if tip.began[2] - tip.p[2] < _FALLEN:
            tip.fallen_at = time
        if time - tip.fallen_at > _SINKING or self.stalled(tip, time):
            return Observation(arrived=True)
        if self.progress(tip) > 2.0 * self.task.config.inset + _STRAY:
            tip.stops = (*tip.stops, Failure.NO_HOLE)
            return Observation(stuck=True)
        return Observation()


class Spiral(Inserting):
    """Moves the upright peg in a spiral over the rim until it falls into the hole."""

    mode = InsertMode.SPIRAL

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Record the rim's height, where the peg rests, and the spiral's start."""
        memory = super().enter(memory, entry)
        tip = insertion_of(memory)
        tip.rim, tip.spiral_at = float(tip.p[2]), entry.time
        return memory

    def radius(self, tip: Insertion, time: float) -> float:
        """Return the radius of the spiral [m].

        A spiral of pitch p has about the length pi r^2 / p, here speed times time.
        """
        length = self.task.config.tip_speed * (time - tip.spiral_at)
        return float(np.sqrt(length * self.task.config.spiral_pitch / np.pi))

    def pull_to(self, tip: Insertion, time: float) -> Vector:
        """Return the point of the spiral, with a pull down, (3,) [m]."""
        config, r = self.task.config, self.radius(tip, time)
        angle = 2.0 * np.pi * r / config.spiral_pitch
        down = self.forward(tip, config.side_force)[2]
        middle = tip.began[:2] + r * np.array([np.cos(angle), np.sin(angle)])
        return np.array([*middle, down])

    def observe_tip(self, tip: Insertion, time: float) -> Observation:
        """Report that the peg has fallen into the hole, or that there is no hole."""
        if tip.rim - tip.p[2] > _FALLEN:
            return Observation(arrived=True)
        if self.radius(tip, time) < self.task.config.spiral_radius:
            return Observation()
        tip.stops = (*tip.stops, Failure.NO_HOLE)
        return Observation(stuck=True)


class Upright(Inserting):
    """Puts the peg upright while its edge stays at the wall."""

    mode = InsertMode.UPRIGHT

    def turn_to(self, tip: Insertion) -> float:
        """Return the tilt to which the set-point turns [rad]."""
        return _PAST

    def pull_to(self, tip: Insertion, time: float) -> Vector:
        """Return the set-point that pulls down and to the wall, (3,) [m]."""
        config = self.task.config
        return self.forward(tip, config.search_force, config.side_force, held=True)

    def observe_tip(self, tip: Insertion, time: float) -> Observation:
        """Report that the hand has turned past upright, as the peg lags."""
        return Observation(arrived=abs(tip.angle - _PAST) < 1e-3)


class Press(Inserting):
    """Presses the peg down, and yields sideways and in angle."""

    mode = InsertMode.PRESS

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Record the start of the pressing."""
        memory = super().enter(memory, entry)
        tip = insertion_of(memory)
        tip.pressed_at = tip.entered_at = tip.sunk_at = entry.time
        tip.sunk = -np.inf
        return memory

    def pull_to(self, tip: Insertion, time: float) -> Vector:
        """Return the set-point that pulls down, (3,) [m].

        A peg that has entered is led by the hole. A hand held beside the hole's axis
        would then wedge the peg.
        """
        outside = self._depth(tip) < _SHALLOW
        return self.forward(tip, self.task.config.push_force, held=outside)

    def rotation(self, tip: Insertion, time: float, share: float) -> RotationMatrix:
        """Follow the peg's orientation R_WT, and put it upright, wobble and turn it.

        A peg that wobbles at the rim also rolls. So, while a key seeks its way, the
        hand turns it around its goal's yaw. Once it has found its way, it stays there.
        """
        assert tip.X_WU is not None
        R_WT = tip.X_WT.rotation()
        R_to = turned(tip.X_WT_measured.rotation(), self._to_upright(tip))
        follow = rotation_vector(R_to @ R_WT.inverse())
        before, tip.twist = tip.twist, self._twist(tip, time)
        turn = (tip.twist - before) * [1.0, 1.0, self.task.round]
        if self._seeks(tip):
            yaw = rotation_vector(R_WT @ tip.X_WU.rotation().inverse())[2]
            most = 2.0 * np.pi / _TWISTING * self.task.config.twist
            most *= self.task.config.period
            follow[2], turn[2] = 0.0, np.clip(tip.twist[2] - yaw, -most, most)
        return turned(turned(R_WT, share * follow), turn)

    def _seeks(self, tip: Insertion) -> bool:
        """Return whether a peg that is not round seeks its way: it hardly sinks."""
        lag = tip.p[2] - tip.X_WT_measured.translation()[2]  # of the low-pass
        sinks = self.task.config.drift * lag > _SINK / _SINK_TIME
        return not (self.task.round or sinks or self._deep(tip))

    def _to_upright(self, tip: Insertion) -> Vector:
        """Return the turn to put a peg upright that might wedge, (3,) [rad]."""
        config = self.task.config
        if self._depth(tip) > _WEDGING * 2.0 * self.task.radius:
            return np.zeros(3)
        turn = np.cross(tip.X_WT_measured.rotation().col(2), _UP)
        return limited(turn, config.upright_torque / config.turning_stiffness)

    def _twist(self, tip: Insertion, time: float) -> Vector:
        """Return the wobble, and the turn about the peg's axis, (3,) [rad].

        While a peg that has entered turns, friction acts along the turn and hardly
        against the way down.
        """
        phase = 2.0 * np.pi * _WOBBLING * (time - tip.pressed_at)
        growth = min((time - tip.pressed_at) * _WOBBLING, 1.0)
        wobble = growth * _WOBBLE * np.array([np.cos(phase), np.sin(phase)])
        if self._depth(tip) < _SHALLOW and tip.twist[2] == 0.0:  # no turn has begun
            tip.entered_at = time
        began = tip.entered_at if self.task.round else tip.pressed_at
        turn = np.sin(2.0 * np.pi * (time - began) / _TWISTING)
        return np.array([*wobble, self.task.config.twist * turn])

    def stalled(self, tip: Insertion, time: float) -> bool:
        """Return whether the peg rests, with its key turned once to both sides."""
        twists = self.task.config.twist and not (self.task.round or self._deep(tip))
        return time - tip.progress_at > _PATIENCE + (_TWISTING if twists else 0.0)

    def _deep(self, tip: Insertion) -> bool:
        config = self.task.config
        return self._depth(tip) >= config.depth - config.depth_tolerance

    def _depth(self, tip: Insertion) -> float:
        """Return how deep the peg is, unless the hand has slipped along it [m]."""
        return tip.rim - float(tip.p[2])

    def observe_tip(self, tip: Insertion, time: float) -> Observation:
        """Report that the peg is seated, or why it goes no deeper."""
        config, depth = self.task.config, self._depth(tip)
        below = depth - config.depth
        if below < config.depth_tolerance or depth > tip.sunk + _SINK:
            tip.sunk, tip.sunk_at = depth, time
        slips = time - tip.sunk_at > _SINK_TIME or below > _BELOW
        late = time - tip.pressed_at > _PRESSING
        if not (slips or late or self.stalled(tip, time)):
            return Observation()
        if not late and self._deep(tip):
            tip.seated = True
            return Observation(arrived=True, at_goal=True)
        why = Failure.TOO_TIGHT if depth < _SHALLOW else Failure.HOLE_BLOCKED
        tip.stops = (*tip.stops, why)
        tip.deepest = max(tip.deepest, depth)
        return Observation(arrived=True)


class Relax(Inserting):
    """Reduces all pull on the seated peg except the push, before the fingers open.

    A set-point that jumped to the tip would jerk the peg upwards. A peg that nothing
    presses leans in a wide hole, and rocks for seconds once it is free.
    """

    mode = InsertMode.RELAX

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Record the tip's pose: a set-point that followed the tip would drift."""
        memory = super().enter(memory, entry)
        tip = insertion_of(memory)
        tip.X_WT_rest = tip.X_WT_measured
        return memory

    def pull_to(self, tip: Insertion, time: float) -> Vector:
        """Return the set-point that presses on the peg where it is, (3,) [m]."""
        lower = self.forward(tip, self.task.config.push_force)
        return np.array([*tip.X_WT_rest.translation()[:2], lower[2]])

    def rotation(self, tip: Insertion, time: float, share: float) -> RotationMatrix:
        """Turn the set-point to the seated tip's orientation R_WT."""
        R_WT, R_rest = tip.X_WT.rotation(), tip.X_WT_rest.rotation()
        return turned(R_WT, share * rotation_vector(R_rest @ R_WT.inverse()))

    def observe_tip(self, tip: Insertion, time: float) -> Observation:
        """Report nothing: the mode ends after a fixed time."""
        return Observation()


class Withdraw(Inserting):
    """Draws the peg out, to try again from the other side or to give up."""

    mode = InsertMode.WITHDRAW
    haste = 3.0

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Count the try, and change sides for the next one."""
        memory = super().enter(memory, entry)
        tip = insertion_of(memory)
        tip.tries, tip.along = tip.tries + 1, -tip.along
        return memory

    def rotation(self, tip: Insertion, time: float, share: float) -> RotationMatrix:
        """Turn the set-point upright, at the rate of a tilt: a jump would jerk."""
        assert tip.X_WU is not None
        tip.angle, R_WT = 0.0, tip.X_WT.rotation()
        turn = rotation_vector(tip.X_WU.rotation() @ R_WT.inverse())
        most = self.task.config.turning * self.task.config.period
        return turned(R_WT, limited(turn, most))

    def pull_to(self, tip: Insertion, time: float) -> Vector:
        """Return the set-point that draws the tip up to the hover height, (3,) [m]."""
        config = self.task.config
        high = tip.rim + config.hover
        drawn = tip.X_WT_measured.translation()[2] + _DRAW / config.stiffness
        return np.array([*tip.p[:2], min(high, drawn)])

    def progress(self, tip: Insertion) -> float:
        """Return the tip's height [m]."""
        return float(tip.p[2])

    def observe_mode(self, memory: PlannerMemory, now: Now) -> Observation:
        """Report that the peg is out and, after the last try, the reason to give up."""
        tip = insertion_of(memory)
        seen = super().observe_mode(memory, now)
        out = seen.arrived and seen.holding  # else the peg is lost, and picked again
        if not out or tip.tries < self.task.config.tries:
            return seen
        met = [stop for stop in tip.stops if stop is not Failure.NO_HOLE]
        failure = met[-1] if met else Failure.NO_HOLE
        deep = f"{1e3 * max(tip.deepest, 0.0):.1f} of {1e3 * self.task.config.depth:g}"
        memory.trouble.message = {
            Failure.NO_HOLE: "the peg slides past where the hole must be",
            Failure.TOO_TIGHT: "the peg meets the hole, but does not go in",
        }.get(failure, f"something in the hole stops the peg: it is {deep} mm deep")
        return dc.replace(seen, failure=failure)

    def observe_tip(self, tip: Insertion, time: float) -> Observation:
        """Report that the tip is above the rim, or that it rests."""
        high = tip.p[2] > tip.rim + 0.5 * self.task.config.hover
        return Observation(arrived=bool(high) or self.stalled(tip, time))


class ReleaseSeated(PegMode, Release):
    """Opens the fingers around the seated peg, and plans the way back from there."""

    mode: ClassVar[AnyMode] = Mode.RELEASE

    def enter(self, memory: PlannerMemory, entry: Entry) -> PlannerMemory:
        """Keep the set-point of a seated peg; otherwise, rest where the arm is."""
        tip, moving = insertion_of(memory), memory.motion
        if not tip.seated or memory.attempt.lost:
            memory.motion = Motion(entry.senses.q.copy())  # the escape begins there
            memory = super().enter(memory, entry)
            memory.motion = moving.led_to(entry.senses.q, entry.time)
            return memory
        memory.motion = moving.ended(entry.time)
        memory.closure = memory.attempt.planned.grasp.closure_open
        memory.attempt.escape = None
        self.replanner.escape(memory, entry.time)
        return memory


class HomeInserted(PegMode, Home):
    """Moves the arm home, and checks there whether the peg is as deep as it felt."""

    def look(self, memory: PlannerMemory, now: Now) -> None:
        """Judge by touch, unless the peg is seen too high: the hand slipped."""
        super().look(memory, now)
        task, tip = self.task, insertion_of(memory)
        peg = self.replanner.find(now.senses.see()) if tip.seated else None
        high = peg is not None and (
            peg.X_WO.translation()[2] - task.X_WO_goal.translation()[2] > task.tolerance
        )
        memory.attempt.at_goal = tip.seated and not high
        tip.seated = False  # a next attempt must feel it anew


INSERTION_MODES: tuple[type[PegMode], ...] = (
    *(Tilt, Search, Slide, Spiral, Upright, Press, Relax, Withdraw),
    *(ReleaseSeated, HomeInserted),
)
