"""Household objects that are dropped on a table, and how they come to rest.

One set of contact settings must bring all objects to rest. Every other set differs from
it in one setting.
"""

import dataclasses as dc
import time as wall
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake import geometry as geo
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

import experiments.runner as ex
from drake_srg.common.contacts import relaxation_time
from drake_srg.common.systems import contact_approximations
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.household import object_facts
from drake_srg.objects.models import AddObject, object_body, simple_shape
from drake_srg.objects.solids import body_corners
from drake_srg.types import Sphere
from experiments import FOLDER
from experiments.data import household_objects

# Half the width of the table, and its thickness [m].
_HALF, _THICKNESS = 0.3, 0.04
_FRICTION = 0.6  # of dry wood, as the tables' models have it
_SAMPLE = 0.02  # time between samples of the motion [s]
# An explosion lifts an object above the place that it was dropped from, by more [m].
_RISE = 0.01
# Roll, pitch and yaw of the object: as it stands, tipped by 11 degrees, and on a side.
# The yaw keeps its edges off the edges of the table's facets.
POSES = {
    "standing": (0.0, 0.0, 0.3),
    "tipped": (0.17, 0.1, 0.3),
    "lying": (np.pi / 2, 0.0, 0.4),
}
HEIGHTS = (0.05, 0.005, 0.02)  # m
REST = 0.005  # an object that moves faster is not at rest [m/s]
# Things that fall over when they are tipped by less than this do not rest but balance,
# until they fall by chance [rad]: a pencil on its end, a card on its edge.
BALANCING = 0.2
# Spans in which speeds count, and the one in which objects must not creep [s].
SOON, LATE, CREEP = (1.2, 1.5), (3.0, 3.3), (3.0, 13.0)


@dc.dataclass(frozen=True)
class Settings:
    """Settings of contact; None keeps what an object has."""

    approximation: str = "lagged"  # of Drake's discrete contact
    time_step: float = 0.005  # of the plant [s]
    cell: float = 0.0  # edge of the facets of a rigid table's top [m]; 0: a box
    mat: float = 5.0e4  # modulus of the table [Pa]; 0: rigid
    mat_dissipation: float = 300.0  # of the table, unless it is rigid [s/m]
    resolution: float = 0.1  # edge of the facets of round things, over their radius
    modulus: float | None = None  # of the objects [Pa]
    dissipation: float | None = None  # of the objects [s/m]


CHOSEN = Settings()
HALF = "half the step"
RIGID = dc.replace(CHOSEN, mat=0.0)
# The first of the others are those of `kitchen`.
SETTINGS = {
    "chosen": CHOSEN,
    "rigid box": dc.replace(RIGID, resolution=0.3),
    "rigid facets of 20 mm": dc.replace(RIGID, cell=0.02, resolution=0.3),
    "rigid facets, objects of 1 MPa, 200 s/m": dc.replace(
        RIGID, cell=0.025, modulus=1.0e6, dissipation=200.0
    ),
    "mat of 1 MPa": dc.replace(CHOSEN, mat=1.0e6),
    "mat of 5 s/m": dc.replace(CHOSEN, mat_dissipation=5.0),
    "round things as coarse as usual": dc.replace(CHOSEN, resolution=0.3),
    **{
        name: dc.replace(CHOSEN, approximation=name)
        for name in contact_approximations()
        if name != CHOSEN.approximation
    },
    "1/1024 s": dc.replace(CHOSEN, time_step=1.0 / 1024.0),
    HALF: dc.replace(CHOSEN, time_step=0.5 * CHOSEN.time_step),
    "10 ms": dc.replace(CHOSEN, time_step=0.01),
}
# The objects dropped with other settings.
COMPARED = ("005_tomato_soup_can", "056_tennis_ball", "mug", "wrench")


def cases(objects: Sequence[str] = ()) -> list[ex.Case]:
    things = household_objects()
    resting = [
        (name, pose)
        for name in ex.chosen("objects", objects, things)
        for pose in POSES
        if tipping_angle(name, things[name], pose) > BALANCING
    ]
    return [
        {"settings": settings, "object": name, "pose": pose, "height": height}
        for settings in SETTINGS
        for height in (HEIGHTS if settings == "chosen" else HEIGHTS[:1])
        for name, pose in resting
        if settings == "chosen" or name in COMPARED
    ]


def trial(settings: str, object: str, pose: str, height: float) -> ex.Measures:
    """Drop an object and let it settle. Samples end where Drake fails."""
    creeps = settings == "chosen" and height == HEIGHTS[0]
    duration = CREEP[1] if creeps else LATE[1]
    config, chosen = household_objects()[object], SETTINGS[settings]
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=chosen.time_step,
            contact_model="hydroelastic_with_fallback",
            discrete_contact_approximation=chosen.approximation,
        ),
        builder,
    )
    _AddTable(plant, chosen)
    config = dc.replace(
        config,
        modulus=chosen.modulus or config.modulus,
        dissipation=chosen.dissipation or config.dissipation,
    )
    if radius := getattr(simple_shape(object, config), "radius", None):
        config.resolution = chosen.resolution * radius
    index = object_body(plant, AddObject(plant, "thing", config))
    assert isinstance(index, BodyIndex)
    body = plant.get_body(index)
    plant.Finalize()
    corners = body_corners(plant, scene_graph.model_inspector(), body)
    if isinstance(config.shape, Sphere):
        corners /= np.sqrt(3.0)  # on its surface
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    R_WO = RollPitchYaw(*POSES[pose]).ToRotationMatrix()
    z = height - (corners @ R_WO.matrix().T)[:, 2].min()
    # Beside the vertices of the facets.
    plant.SetFloatingBaseBodyPoseInWorldFrame(
        context, body, RigidTransform(R_WO, [0.003, 0.004, z])
    )
    times, speeds, positions, failed = [], [], [], False
    start = wall.process_time()
    simulator.Initialize()
    for k in range(round(duration / _SAMPLE) + 1):
        try:
            simulator.AdvanceTo(k * _SAMPLE)
        except RuntimeError:  # the solver did not converge
            failed = True
            break
        X_WO = body.EvalPoseInWorld(context)
        V = body.EvalSpatialVelocityInWorld(context)
        arms = corners @ X_WO.rotation().matrix().T
        v = V.translational() + np.cross(V.rotational(), arms)
        times.append(k * _SAMPLE)
        speeds.append(np.linalg.norm(v, axis=1).max())
        positions.append(X_WO @ body.CalcCenterOfMassInBodyFrame(context))
    elapsed = wall.process_time() - start
    time, speed, position = np.array(times), np.array(speeds), np.array(positions)

    def moves(span: tuple[float, float]) -> bool:
        rows = (time > span[0] - 1e-9) & (time < span[1] + 1e-9)
        return bool(not rows.any() or speed[rows].max() > REST)

    creep = np.inf if creeps else None
    if creeps and time[-1] >= CREEP[0]:
        first = np.searchsorted(time, CREEP[0] - 1e-9)
        creep = 1e3 * float(np.linalg.norm(position[-1] - position[first]))
    return {
        "exploded": failed or position[:, 2].max() > position[0, 2] + _RISE,
        "soon": moves(SOON),
        "late": moves(LATE),
        "creep": creep,
        "sunk": -1e3 * min((X_WO @ corner)[2] for corner in corners),
        "height at rest": 1e3 * position[-1, 2],
        "simulated": time[-1],
        "elapsed": elapsed,
    }


def tipping_angle(name: str, config: ObjectConfig, pose: str) -> float:
    """Return the angle by which an object in a pose can tip without falling [rad].

    It counts as a box. A pose that is tipped is judged as the one it is tipped from.
    """
    x, y, z = object_facts(name, config).size
    if pose == "lying":
        y, z = z, y
    return float(np.arctan2(min(x, y), z))


def _AddTable(plant: MultibodyPlant, settings: Settings) -> None:
    """Add a table whose top is z = 0."""
    shape: geo.Shape = geo.Box(2 * _HALF, 2 * _HALF, _THICKNESS)
    X_WT = RigidTransform([0.0, 0.0, -0.5 * _THICKNESS])
    if settings.cell:  # the same box, but for the grid of its top
        mesh = FOLDER / f"data/tables/facets_{1e3 * settings.cell:.0f}_mm.obj"
        shape, X_WT = geo.Mesh(str(mesh)), RigidTransform()
    d = settings.mat_dissipation if settings.mat else 0.0
    properties = geo.ProximityProperties()
    geo.AddContactMaterial(
        dissipation=d,
        friction=CoulombFriction(_FRICTION, _FRICTION),
        properties=properties,
    )
    properties.AddProperty("material", "relaxation_time", relaxation_time(d))
    if settings.mat:
        geo.AddCompliantHydroelasticProperties(
            resolution_hint=_HALF,  # a box ignores it
            hydroelastic_modulus=settings.mat,
            properties=properties,
        )
    else:
        geo.AddRigidHydroelasticProperties(properties)
    plant.RegisterCollisionGeometry(
        plant.world_body(), X_WT, shape, "table_top", properties
    )


def summary(own: ex.Trials) -> ex.Values:
    n, height = len(own), "height at rest"
    exploded, soon, late = (sum(own[k]) for k in ("exploded", "soon", "late"))
    chosen = own.whole.where(settings="chosen")
    if own.name == "chosen":
        sunk = max(own.where(pose="standing")["sunk"])
        return {
            "explosions [drops]": (exploded, ex.at_most(0.0)),
            "moving after 1.2 s [of the drops]": (soon / n, ex.at_most(1.0 / 50.0)),
            "moving after 3 s [drops]": (late, ex.at_most(0.0)),
            "creep in 10 s [mm]": max(own.known("creep")),
            "deepest in the table at rest [mm]": sunk,
        }
    spread = ex.number(spread=max(3.0, 0.1 * n))  # contact is chaotic
    speeds = [sum(t["simulated"]) / sum(t["elapsed"]) for t in (own, chosen)]
    speed = speeds[0] / speeds[1]
    faster = ex.number(spread=0.5 * speed)
    found: dict[str, Any] = {
        f"explosions [of {n} drops]": (exploded, spread),
        f"moving after 1.2 s [of {n} drops]": (soon, spread),
        f"moving after 3 s [of {n} drops]": (late, spread),
        "speed of simulation [of the chosen one's]": (speed, faster),
    }
    if own.name == HALF:
        standing, same = own.where(pose="standing"), ("object", "pose", "height")
        found["change of the height at rest [mm]"] = max(
            abs(t[height] - chosen.where(**{k: t[k] for k in same}).one(height))
            for t in standing
        )
    return found


resting = ex.Experiment(
    "Household objects that are dropped on a table, and how they come to rest.",
    cases,
    trial,
    {
        "creep in 10 s": ex.at_most(1.0),
        "change of the height at rest": ex.at_most(0.1),
    },
    summary=summary,
    picture=[ex.Points("sunk", "elapsed", log="y")],
    serial=True,
)
