"""The set-points of an insertion's modes, and the modes' ends."""

import dataclasses as dc
import types

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from drake_srg.planning.insertion.config import Insert, Insertion, InsertMemory, Task
from drake_srg.planning.insertion.modes import (
    HomeInserted,
    Press,
    Relax,
    ReleaseSeated,
    Search,
    Slide,
    Spiral,
    Tilt,
    Upright,
    Withdraw,
)
from drake_srg.planning.insertion.planner import InsertionPlanner
from drake_srg.planning.motion.arm_motion import Motion
from drake_srg.planning.pick_and_place.sightings import PickTask
from drake_srg.planning.servoing.hand_motion import ServoArm
from drake_srg.planning.state_machine import Entry, Moment
from drake_srg.types import Box, Cylinder, Failure, Sphere

CONFIG = Insert()
PEG = Cylinder(0.0124, 0.1)
RIM = np.array([0.5, -0.3, 0.03])
GOAL = RigidTransform([0.5, -0.3, 0.06])
UP = np.array([0.0, 0.0, 1.0])
ALONG = np.array([0.0, 1.0, 0.0])
X_TG = RigidTransform([0.0, 0.0, 0.1])


@dc.dataclass(frozen=True)
class Measured:
    """The part of the senses that the modes read."""

    def see(self):
        return None

    q: np.ndarray
    grasped: bool = True
    fingers: np.ndarray = dc.field(default_factory=lambda: np.zeros(4))
    external_torque: None = None
    proximity: np.ndarray = dc.field(default_factory=lambda: np.zeros(4))


class FreeHand:
    """A hand with six joints: its position and its roll, pitch and yaw."""

    step, track = ServoArm.step, ServoArm.track
    speed, lower, upper = np.full(6, 10.0), np.full(6, -10.0), np.full(6, 10.0)
    acceleration = np.full(6, 10.0)

    def X_WG(self, q):
        return RigidTransform(RollPitchYaw(q[3:]), q[:3])

    def jacobian(self, q):
        return np.eye(6)  # as long as it only rolls


TASK = Task(CONFIG, FreeHand(), PEG, GOAL, 0.003)


def joints(p_WT):
    """The joints that hold an upright peg with its tip at a point; joints stay."""
    if len(p_WT) == 6:
        return p_WT
    return np.concatenate([p_WT + 0.1 * UP, np.zeros(3)])


def moment(time, q):
    return Moment(time, Measured(q))


def make_memory(p_WT):
    """A memory in which the hand holds the peg with its tip at a point."""
    memory = InsertMemory(Motion(joints(p_WT)))
    memory.grip.angles = np.zeros(4)
    grasp = types.SimpleNamespace(holds=lambda q, proximity: True)
    memory.attempt.motions = types.SimpleNamespace(grasp=grasp, motions={})
    memory.insertion = Insertion(
        q=joints(p_WT),
        v=np.zeros(6),
        X_TG=X_TG,
        X_WU=RigidTransform(RIM),
        X_WT=RigidTransform(p_WT),
        along=ALONG,
        rim=RIM[2],
    )
    return memory


def enter(mode, memory, q):
    return mode.enter(memory, Entry(0.0, Measured(q), None, None))


def run(mode, memory, tip_at, duration):
    """Update a mode while the tip is at a place; return its memory and observation.

    The place [m] may be a function of the memory.
    """
    where = tip_at if callable(tip_at) else lambda memory: tip_at
    memory = enter(mode, memory, joints(where(memory)))
    for i in range(1, round(duration / CONFIG.period)):
        now = moment(i * CONFIG.period, joints(where(memory)))
        memory = mode.update(memory, now)
        seen = mode.observe_mode(memory, now)
    return memory, seen


def pull(memory):
    """Force with which the set-point pulls the tip [N]."""
    tip = memory.insertion
    p = tip.X_WT.translation() - tip.X_WT_measured.translation()
    return CONFIG.stiffness * p


def test_the_tilted_edge_is_inside_the_rim():
    mode = Tilt(TASK, None, 1)
    memory = make_memory(RIM + 0.01 * UP)
    memory, seen = run(mode, memory, lambda memory: memory.insertion.q, 3.0)
    assert seen.arrived
    X_WT = memory.insertion.X_WT
    edge = X_WT @ [0.0, PEG.radius, 0.0]
    assert edge[1] - RIM[1] == pytest.approx(PEG.radius - CONFIG.inset, abs=1e-3)
    assert X_WT.rotation().col(2)[1] == pytest.approx(np.sin(CONFIG.tilt), abs=0.002)
    assert edge[2] < (X_WT @ [0.0, -PEG.radius, 0.0])[2]  # it is the lower one
    assert edge[2] > RIM[2]


def test_a_hand_that_does_not_get_over_the_hole_is_stopped():
    held = RIM - 0.01 * UP
    _, seen = run(Tilt(TASK, None, 1), make_memory(held), held, 5.0)
    assert not seen.arrived and seen.failure is None
    _, seen = run(Tilt(TASK, None, 1), make_memory(held), held, 6.5)
    assert seen.failure is Failure.STOPPED


def test_a_tip_at_rest_is_pulled_with_the_search_force_and_found():
    memory, seen = run(Search(TASK, None, 1), make_memory(RIM), RIM, 1.0)
    assert pull(memory) == pytest.approx([0.0, 0.0, -CONFIG.search_force], abs=0.05)
    assert seen.arrived


def test_a_wall_ends_the_slide_and_its_absence_is_told():
    mode = Slide(TASK, None, 1)
    memory, seen = run(mode, make_memory(RIM), RIM, 1.0)
    assert seen.arrived
    assert not seen.stuck
    assert pull(memory)[1] == pytest.approx(CONFIG.side_force, abs=0.1)

    def yielding(memory):
        return RIM + (memory.insertion.X_WT.translation()[1] - RIM[1]) * ALONG

    memory, seen = run(mode, make_memory(RIM), yielding, 1.5)
    assert seen.stuck
    assert Failure.NO_HOLE in memory.insertion.stops


def test_an_edge_that_sinks_is_at_the_wall_although_the_hand_creeps_on():
    mode, memory = Slide(TASK, None, 1), make_memory(RIM)
    memory, seen = run(mode, memory, RIM, 0.1)
    q = joints(RIM - 0.001 * UP)
    for i in range(100):
        start = 0.1 + i * CONFIG.period
        q = q + np.array([0.0, 2e-5, 0.0, 0.0, 0.0, 0.0])
        memory = mode.update(memory, moment(start, q))
        if (seen := mode.observe_mode(memory, moment(start, q))).arrived:
            break
    assert seen.arrived
    assert not seen.stuck
    assert start == pytest.approx(0.75, abs=0.15)


def test_a_hand_that_creeps_down_for_long_has_inserted_nothing():
    mode, memory = Press(TASK, None, 1), make_memory(RIM - 0.001 * UP)
    q, time = joints(RIM - 0.001 * UP), 0.0
    memory, now = enter(mode, memory, q), moment(time, q)
    while not mode.observe_mode(memory, now).arrived:
        time += CONFIG.period
        creep = RIM - (0.001 + 0.0018 * time) * UP
        now = moment(time, joints(creep))
        memory = mode.update(memory, now)
    assert 9.9 < time < 10.2
    assert not memory.insertion.seated
    assert memory.insertion.stops == (Failure.HOLE_BLOCKED,)


def test_a_spiral_passes_every_place_within_its_radius():
    config = dc.replace(CONFIG, strategy="spiral", spiral_radius=0.001)
    mode = Spiral(dc.replace(TASK, config=config), None, 1)
    tip = make_memory(RIM).insertion
    tip.began = tip.p = RIM
    times = np.arange(0.0, 5.0, config.period)
    radii = np.array([mode.radius(tip, t) for t in times])
    path = np.array([mode.pull_to(tip, t)[:2] - RIM[:2] for t in times])
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1) / config.period
    assert steps[20:] == pytest.approx(config.tip_speed, rel=0.05)
    path = path[radii < config.spiral_radius]
    rng = np.random.default_rng(0)
    for _ in range(100):
        r, angle = 9e-4 * np.sqrt(rng.random()), 2 * np.pi * rng.random()
        place = r * np.array([np.cos(angle), np.sin(angle)])
        gap = np.linalg.norm(path - place, axis=1).min()
        assert gap < 0.5 * np.hypot(config.spiral_pitch, 1.5e-4)


def test_a_peg_that_falls_in_ends_the_spiral_and_a_whole_spiral_is_told():
    config = dc.replace(CONFIG, strategy="spiral")
    mode = Spiral(dc.replace(TASK, config=config), None, 1)
    memory, seen = run(mode, make_memory(RIM), RIM, 1.0)
    assert not (seen.arrived or seen.stuck)
    assert pull(memory)[2] == pytest.approx(-config.side_force, abs=0.05)
    memory.insertion.p = RIM - 0.001 * UP
    assert mode.observe_tip(memory.insertion, 1.0).arrived
    memory.insertion.p = RIM
    assert mode.observe_tip(memory.insertion, 30.0).stuck
    assert memory.insertion.stops == (Failure.NO_HOLE,)


def test_a_peg_in_the_hole_leads_the_hand_aside():
    mode, aside = Press(TASK, None, 1), np.array([0.002, 0.0015, 0.0])
    for depth, held in ((0.002, True), (0.006, False)):
        p = RIM - depth * UP
        memory, _ = run(mode, make_memory(p), lambda memory, p=p: p + aside, 0.05)
        memory.insertion.began = p
        for i in range(100):
            now = moment(0.05 + i * CONFIG.period, joints(p + aside))
            memory = mode.update(memory, now)
        expected = -CONFIG.stiffness * aside[:2] * held
        assert pull(memory)[:2] == pytest.approx(expected, abs=0.1)


def test_a_stuck_peg_is_drawn_out_with_less_than_makes_the_hand_slip():
    memory = make_memory(RIM - 0.005 * UP)
    mode = Withdraw(TASK, None, 1)
    memory, _ = run(mode, memory, lambda memory: RIM - 0.005 * UP, 0.5)
    assert 8.0 < pull(memory)[2] < 12.0


def test_a_peg_that_is_drawn_out_turns_back_without_a_jump():
    memory, twisted = make_memory(RIM - 0.005 * UP), RollPitchYaw(0.0, 0.0, 0.015)
    memory.insertion.X_WT = RigidTransform(twisted, RIM - 0.005 * UP)
    mode, yaw = Withdraw(TASK, None, 1), []
    memory = enter(mode, memory, joints(RIM - 0.005 * UP))
    for i in range(1, 20):
        now = moment(i * CONFIG.period, joints(RIM - 0.005 * UP))
        memory = mode.update(memory, now)
        yaw.append(RollPitchYaw(memory.insertion.X_WT.rotation()).vector()[2])
    steps = np.abs(np.diff([0.015, *yaw]))
    assert steps.max() < 1.01 * CONFIG.turning * CONFIG.period
    assert abs(yaw[-1]) < 1e-3


@pytest.mark.parametrize(
    ("peg", "steps"), [(PEG, (0, 0, 1, -1)), (Box([0.02, 0.02, 0.1]), (0, -1, 1, -2))]
)
def test_further_tries_search_aside(peg, steps):
    mode = Tilt(dc.replace(TASK, peg=peg), None, 1)
    for tries, expected in enumerate(steps):
        tip = make_memory(RIM).insertion
        tip.tries, tip.along = tries, (-1.0) ** tries * ALONG
        aside = RIM[0] - mode.pull_to(tip, 0.0)[0]
        assert aside == pytest.approx(expected * CONFIG.search_step, abs=1e-9)


@pytest.mark.parametrize("kind", [Slide, Upright, Press])
def test_a_peg_that_swivels_does_not_draw_the_hand_aside(kind):
    mode, aside = kind(TASK, None, 1), np.array([0.002, 0.0, 0.0])
    memory, _ = run(mode, make_memory(RIM), RIM + aside, 0.05)
    memory.insertion.began = RIM
    wiggle = 1.3 if kind is Slide else 0.1  # [N]
    for i in range(100):
        now = moment(0.05 + i * CONFIG.period, joints(RIM + aside))
        memory = mode.update(memory, now)
    held = -CONFIG.stiffness * aside[0]
    assert pull(memory)[0] == pytest.approx(held, abs=wiggle)


def test_a_hand_turns_past_upright_however_deep_the_peg_is():
    mode = Upright(TASK, None, 1)  # the peg leans by more than the hand
    tip = make_memory(RIM).insertion
    tip.p, tip.angle = RIM - 0.006 * UP, 0.0
    assert not mode.observe_tip(tip, 1.0).arrived
    tip.angle = mode.turn_to(tip)
    assert tip.angle < 0.0
    assert mode.observe_tip(tip, 1.0).arrived


def test_a_bore_meets_the_pin_with_the_other_side():
    task = dc.replace(TASK, config=dc.replace(CONFIG, over=True, tip=0.01))
    tip = make_memory(RIM).insertion
    assert task.wall(tip) == pytest.approx(-ALONG)
    tilted = Tilt(task, None, 1).pull_to(tip, 0.0) - RIM
    edge = tilted[1] + 0.01 * np.cos(CONFIG.tilt)
    assert edge == pytest.approx(0.01 + CONFIG.inset)


def pressed(task, p_WT, duration, roll=0.0):
    """Set-points' turns [rad] of a tip that is pressed and rests, leaning by `roll`."""
    mode, memory, turns = Press(task, None, 1), make_memory(p_WT), []
    lean = RollPitchYaw(roll, 0.0, 0.0)
    hand = RigidTransform(lean, p_WT) @ X_TG
    q = np.concatenate([hand.translation(), lean.vector()])
    memory.insertion.X_WT = RigidTransform(lean, p_WT)
    memory = enter(mode, memory, q)
    for i in range(1, round(duration / CONFIG.period)):
        now = moment(i * CONFIG.period, q)
        memory = mode.update(memory, now)
        measured = memory.insertion.X_WT_measured.rotation()
        turn = memory.insertion.X_WT.rotation() @ measured.inverse()
        turns.append(RollPitchYaw(turn).vector())
    return np.array(turns), mode.observe_tip(memory.insertion, duration)


def test_a_key_is_turned_to_both_sides_before_the_peg_counts_as_blocked():
    config, proxy = dc.replace(CONFIG, twist=0.03), Box([0.02, 0.02, 0.1])
    task = dc.replace(TASK, config=config, peg=proxy)
    turns, seen = pressed(task, RIM - 0.006 * UP, 1.7)
    assert not seen.arrived
    turns, seen = pressed(task, RIM - 0.006 * UP, 2.7)
    assert seen.arrived
    yaw = turns[:, 2]
    assert yaw.min() < -0.01
    assert yaw.max() > 0.01


def test_a_key_is_turned_around_its_goal_until_it_has_found_its_way():
    config, proxy = dc.replace(CONFIG, twist=0.03), Box([0.02, 0.02, 0.1])
    task = dc.replace(TASK, config=config, peg=proxy)
    mode, rolled = Press(task, None, 1), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.04])
    for speed, low, high in ((0.0, -0.03, 0.03), (0.006, 0.04, 0.04)):
        memory = make_memory(RIM)
        p = RIM - 0.004 * UP
        memory.insertion.X_WT = RigidTransform(RollPitchYaw(rolled[3:]), p)
        memory.insertion.q = joints(p) + rolled
        memory, yaw = enter(mode, memory, joints(p) + rolled), []
        for i in range(1, 200):
            time = i * CONFIG.period
            q = joints(p - speed * time * UP) + rolled
            if speed == 0.0:  # it turns with the hand
                q[3:] = memory.insertion.q[3:]
            memory = mode.update(memory, moment(time, q))
            yaw.append(RollPitchYaw(memory.insertion.X_WT.rotation()).vector()[2])
        assert min(yaw[50:]) == pytest.approx(low, abs=0.005)
        assert max(yaw[50:]) == pytest.approx(high, abs=0.005)


def test_a_cylinder_turns_about_its_axis_once_it_has_entered():
    outside, _ = pressed(TASK, RIM - 0.002 * UP, 1.4)
    # Otherwise, the hand would slip along a peg that is too thick.
    assert np.abs(outside[:, 2]).max() < 1e-3
    yaw = pressed(TASK, RIM - 0.006 * UP, 1.4)[0][:, 2]
    assert abs(yaw[5]) > 1e-3
    most = CONFIG.torque_limit / CONFIG.turning_stiffness
    assert yaw.min() == pytest.approx(-most, rel=0.2)
    assert yaw.max() == pytest.approx(most, rel=0.2)


def test_a_peg_that_goes_to_and_fro_at_the_rim_does_not_turn_in_jumps():
    mode, memory = Press(TASK, None, 1), make_memory(RIM)
    memory = enter(mode, memory, joints(RIM))
    yaw = []
    for i in range(1, 300):
        time = i * CONFIG.period
        depth = 0.003 + 0.002 * np.sin(2.0 * np.pi * time)
        memory = mode.update(memory, moment(time, joints(RIM - depth * UP)))
        yaw.append(memory.insertion.twist[2])
    assert max(yaw) > 0.9 * CONFIG.twist
    # Its speed is that of one turn back and forth a second.
    steps = np.abs(np.diff(yaw))
    assert steps.max() < 1.05 * 2.0 * np.pi * CONFIG.twist * CONFIG.period


@pytest.mark.parametrize("roll", [0.03, -0.03])
def test_a_leaning_peg_that_may_wedge_is_put_upright(roll):
    period = 2.0 / 3.0  # of the wobble
    task = dc.replace(TASK, config=dc.replace(CONFIG, twist=0.0))
    shallow, _ = pressed(task, RIM - 0.004 * UP, 4 * period, roll)
    deep, _ = pressed(task, RIM - 0.012 * UP, 4 * period, roll)
    last = round(period / CONFIG.period)
    torque = CONFIG.turning_stiffness * shallow[-last:, 0].mean()
    assert torque == pytest.approx(-np.sign(roll) * CONFIG.upright_torque, rel=0.2)
    guided = CONFIG.turning_stiffness * deep[-last:, 0].mean()
    assert abs(guided) < 0.2 * CONFIG.upright_torque


@pytest.mark.parametrize(
    ("depth", "seated", "stops"),
    [
        (0.0195, True, ()),
        (0.012, False, (Failure.HOLE_BLOCKED,)),
        (0.001, False, (Failure.TOO_TIGHT,)),
    ],
)
def test_the_depth_at_which_the_peg_stops_tells_what_stops_it(depth, seated, stops):
    bottom = RIM - depth * UP
    memory, seen = run(Press(TASK, None, 1), make_memory(bottom), bottom, 1.53)
    assert seen.arrived
    assert seen.at_goal is seated
    assert memory.insertion.seated is seated
    assert memory.insertion.stops == stops


def test_a_seated_peg_is_pressed_until_the_fingers_open_but_not_pulled_aside():
    bottom, turn = RIM - 0.02 * UP, RollPitchYaw(0.0, 0.0, 0.02)
    pressed = RigidTransform(turn, bottom - [0.0005, 0.0, 0.003])
    hand = (pressed @ X_TG).translation()
    memory, mode = make_memory(bottom), Relax(TASK, None, 1)
    memory.insertion.X_WT = pressed
    memory.insertion.q = np.concatenate([hand, turn.vector()])
    memory = enter(mode, memory, joints(bottom))
    places = [memory.insertion.q]
    for i in range(1, round(0.5 / CONFIG.period)):
        now = moment(i * CONFIG.period, joints(bottom))
        memory = mode.update(memory, now)
        places.append(memory.insertion.q)
    steps = np.abs(np.diff(places, axis=0))
    # An arm that was too slow at first catches up.
    assert steps[:, :3].max() < 1.25 * CONFIG.tip_speed * CONFIG.period
    push = [0.0, 0.0, -CONFIG.push_force]
    assert pull(memory) == pytest.approx(push, abs=0.3)
    left = memory.insertion.X_WT.rotation().ToAngleAxis().angle()
    assert CONFIG.turning_stiffness * left < 0.2

    memory.insertion.seated = True
    memory.attempt.motions.grasp.closure_open = 0.5
    replanner = types.SimpleNamespace(escape=lambda memory, time: None)
    opened = enter(ReleaseSeated(TASK, replanner, 1), memory, joints(bottom))
    assert opened.closure == 0.5
    # It brakes from a few mrad/s.
    assert opened.motion.destination == pytest.approx(places[-1], abs=1e-4)


@pytest.mark.parametrize("lost", [False, True])
def test_no_change_of_mode_needs_more_than_the_joints_accelerations(lost):
    """A mode that ends too early, and a peg that is lost, must not jerk the arm."""
    arm, period = FreeHand(), CONFIG.period
    arm.acceleration = np.full(6, 0.5)
    task, time, places = dc.replace(TASK, arm=arm), 0.0, []
    memory = make_memory(RIM + 0.02 * UP)
    memory.attempt.motions.grasp.closure_open = 0.5
    memory.attempt.motions.grasp.name = "pinch"

    def record(duration):
        times = time + np.arange(0.0, duration, 0.5 * period)
        places.extend(memory.motion.position(t) for t in times)

    def update():
        nonlocal memory, time
        record(period)
        time += period
        memory = mode.update(memory, moment(time, memory.insertion.q + 0.002))

    for kind in (Tilt, Search, Upright, Withdraw, Press, Withdraw):
        mode = kind(task, None, 1)
        q = memory.motion.position(time) + 0.002
        memory = mode.enter(memory, Entry(time, Measured(q), None, None))
        for _ in range(20):
            update()
    if lost:
        memory.attempt.lost = True
        update()
    q = memory.motion.position(time) + 0.002
    replanner = types.SimpleNamespace(escape=lambda memory, time: None)
    release = ReleaseSeated(task, replanner, 1)
    memory = release.enter(memory, Entry(time, Measured(q), None, None))
    assert memory.motion.q_rest == pytest.approx(q)
    record(1.0)
    assert places[-1] == pytest.approx(q)
    accelerations = np.diff(places, 2, axis=0) / (0.5 * period) ** 2
    assert np.abs(accelerations).max() < 1.01 * arm.acceleration[0]


def test_a_hand_that_slips_along_the_seated_peg_stops():
    def sinking(memory):
        return memory.insertion.p - 0.01 * UP  # always further

    deep = RIM - 0.02 * UP
    _, seen = run(Press(TASK, None, 1), make_memory(deep), sinking, 0.1)
    assert seen.at_goal


@pytest.mark.parametrize(("speed", "seated"), [(0.004, False), (0.0003, True)])
def test_a_hand_that_slips_along_a_sinking_peg_presses_on(speed, seated):
    start = RIM - 0.0221 * UP  # the hand has slipped by 2 mm or so
    mode, memory = Press(TASK, None, 1), make_memory(start)
    memory = enter(mode, memory, joints(start))
    ended = False
    for i in range(1, round(0.65 / CONFIG.period)):
        time = i * CONFIG.period
        deep = start - speed * time * UP
        now = moment(time, joints(deep))
        memory = mode.update(memory, now)
        ended |= mode.observe_mode(memory, now).arrived
    assert ended is seated


def test_no_set_point_pulls_with_more_than_the_limits():
    memory = make_memory(RIM)
    memory.insertion.X_WT = RigidTransform(
        RollPitchYaw(0.3, 0.0, 0.0), RIM - [0.05, 0.0, 0.05]
    )
    memory, _ = run(Press(TASK, None, 1), memory, RIM, 0.03)
    assert np.linalg.norm(pull(memory)) < CONFIG.force_limit + 1e-6
    turn = memory.insertion.X_WT.rotation().ToAngleAxis().angle()
    assert turn < CONFIG.torque_limit / CONFIG.turning_stiffness + 1e-6


def test_the_next_try_comes_from_the_other_side_and_the_last_one_gives_up():
    mode, memory = Withdraw(TASK, None, 1), make_memory(RIM)
    high = RIM + 0.02 * UP
    for tries in range(1, CONFIG.tries + 1):
        memory.insertion.stops += (Failure.NO_HOLE,)
        memory, seen = run(mode, memory, high, 0.1)
        assert memory.insertion.tries == tries
        assert memory.insertion.along == pytest.approx((-1.0) ** tries * ALONG)
        last = tries == CONFIG.tries
        assert seen.failure is (Failure.NO_HOLE if last else None)
    assert "slides past" in memory.trouble.message


def test_what_was_met_counts_more_than_what_was_missed():
    memory = make_memory(RIM)
    memory.insertion.tries = CONFIG.tries - 1
    memory.insertion.stops = (Failure.HOLE_BLOCKED, Failure.NO_HOLE)
    memory.insertion.deepest = 0.0123
    memory, seen = run(Withdraw(TASK, None, 1), memory, RIM + 0.02 * UP, 0.1)
    assert seen.failure is Failure.HOLE_BLOCKED
    assert "12.3 of 20 mm" in memory.trouble.message


def test_a_peg_that_is_lost_in_the_last_try_is_not_a_hole_that_is_missed():
    memory, mode = make_memory(RIM), Withdraw(TASK, None, 1)
    memory.insertion.tries = CONFIG.tries - 1
    memory = enter(mode, memory, joints(RIM))
    memory.attempt.lost = True
    seen = mode.observe_mode(memory, moment(CONFIG.period, joints(RIM)))
    assert seen.arrived
    assert not seen.holding
    assert seen.failure is None


def test_modes_change_only_their_draft_of_the_memory():
    memory = make_memory(RIM)
    before = memory.insertion.X_WT, memory.insertion.q.copy()
    run(Press(TASK, None, 1), memory.__copy__(), RIM, 0.1)
    assert memory.insertion.X_WT is before[0]
    assert np.array_equal(memory.insertion.q, before[1])


@pytest.mark.parametrize(
    ("felt", "seen_above", "at_goal"),
    [
        (True, 0.001, True),
        (True, None, True),  # hidden
        (True, 0.008, False),  # the hand slipped along the peg
        (False, 0.001, False),
    ],
)
def test_sight_contradicts_a_hand_that_slipped_along_the_peg(felt, seen_above, at_goal):
    blob = None
    if seen_above is not None:
        p = GOAL.translation() + seen_above * UP
        blob = types.SimpleNamespace(X_WO=RigidTransform(p))
    memory = make_memory(RIM)
    memory.insertion.seated = felt
    memory.trouble.failure = Failure.DROPPED if not felt else None
    replanner = types.SimpleNamespace(
        find=lambda view: blob, judge=lambda view, memory, time: None
    )
    now = moment(1.0, joints(RIM))
    home = HomeInserted(TASK, replanner, 1)
    home.look(memory, now)
    assert memory.attempt.at_goal is at_goal
    home.look(memory, now)  # after an attempt that never reached the hole
    assert memory.attempt.at_goal is False


def test_only_cylinders_and_boxes_are_inserted():
    with pytest.raises(ValueError, match=r"objects\.peg: must be a cylinder or a box"):
        InsertionPlanner(None, PickTask("peg", Sphere(0.01), RigidTransform()), CONFIG)
