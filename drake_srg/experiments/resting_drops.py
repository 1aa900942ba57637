"""One object, dropped on a table: how it comes to rest."""

from __future__ import annotations

import dataclasses as dc
import time as wall

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    InMemoryMesh,
    Mesh,
    ProximityProperties,
    Shape,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    AddMultibodyPlantSceneGraph,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from drake_srg.common.contacts import relaxation_time
from drake_srg.objects.config import ObjectConfig
from drake_srg.objects.models import AddObject, object_body, simple_shape
from drake_srg.objects.slab_mesh import obj_text, slab_mesh
from drake_srg.objects.solids import body_corners
from drake_srg.types import Sphere, Vector

# Half the width of the table, and its thickness [m].
_HALF, _THICKNESS = 0.3, 0.04
_FRICTION = 0.6  # of dry wood, as the tables' models have it
_SAMPLE = 0.02  # time between samples of the motion [s]
# An explosion lifts an object above the place that it was dropped from, by more than
# this [m].
_RISE = 0.01

# Roll, pitch and yaw of the object: as it stands, tipped by 11 degrees, and on a side.
# The yaw keeps its edges off the edges of the table's facets.
POSES = {
    "standing": (0.0, 0.0, 0.3),
    "tipped": (0.17, 0.1, 0.3),
    "lying": (np.pi / 2, 0.0, 0.4),
}


@dc.dataclass(frozen=True)
class Settings:
    """Settings of contact.

    Attributes:
        approximation: Of Drake's discrete contact.
        time_step: Of the plant [s].
        cell: Edge of the facets of a rigid table's top [m]; 0 makes it a box.
        mat: Modulus of the table [Pa]; 0 makes it rigid.
        mat_dissipation: Of the table, unless it is rigid [s/m].
        resolution: Edge of the facets of cylinders and balls, over their radius.
        modulus: Of the objects [Pa]; None keeps what each has.
        dissipation: Of the objects [s/m]; None keeps what each has.
    """

    approximation: str = "lagged"
    time_step: float = 0.005
    cell: float = 0.0
    mat: float = 5.0e4
    mat_dissipation: float = 300.0
    resolution: float = 0.1
    modulus: float | None = None
    dissipation: float | None = None


@dc.dataclass(frozen=True)
class Drop:
    """An object, its pose (of `POSES`) and how high it is [m]."""

    name: str
    pose: str
    height: float

    def __str__(self) -> str:
        return f"{self.name}, {self.pose}, {1e3 * self.height:g} mm"


@dc.dataclass(frozen=True)
class Motion:
    """The motion of a dropped object. Samples end where Drake fails.

    Attributes:
        time: Shape (K,) [s].
        speed: Of the fastest corner of the box around it, shape (K,) [m/s].
        position: Of its centre of mass, shape (K, 3) [m].
        sunk: Depth of the lowest corner of the box around it at the end [m].
        exploded: Whether it rose above its start, or Drake failed.
        wall: Processor time of the simulation [s].
    """

    time: Vector
    speed: Vector
    position: Vector
    sunk: float
    exploded: bool
    wall: float

    def fastest(self, start: float, end: float) -> float:
        """Return the largest speed in a span of time [m/s]; infinite after failure."""
        rows = (self.time > start - 1e-9) & (self.time < end + 1e-9)
        return float(self.speed[rows].max()) if rows.any() else np.inf

    def creep(self, start: float) -> float:
        """Return the distance from the position at a time to the last one [m]."""
        if self.time[-1] < start:
            return np.inf
        first = self.position[np.searchsorted(self.time, start - 1e-9)]
        return float(np.linalg.norm(self.position[-1] - first))


def simulate(
    drop: Drop, config: ObjectConfig, settings: Settings, duration: float
) -> Motion:
    """Drop an object and let it settle for a duration [s]."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=settings.time_step,
            contact_model="hydroelastic_with_fallback",
            discrete_contact_approximation=settings.approximation,
        ),
        builder,
    )
    _AddTable(plant, settings)
    config = dc.replace(
        config,
        modulus=settings.modulus or config.modulus,
        dissipation=settings.dissipation or config.dissipation,
    )
    radius = getattr(simple_shape(drop.name, config), "radius", None)
    if radius:
        config.resolution = settings.resolution * radius
    index = object_body(plant, AddObject(plant, "thing", config))
    assert isinstance(index, BodyIndex)
    body = plant.get_body(index)
    plant.Finalize()
    corners = body_corners(plant, scene_graph.model_inspector(), body)
    if isinstance(config.shape, Sphere):
        corners /= np.sqrt(3.0)  # on its surface
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    R_WO = RollPitchYaw(*POSES[drop.pose]).ToRotationMatrix()
    z = drop.height - (corners @ R_WO.matrix().T)[:, 2].min()
    # Beside the vertices of the facets.
    plant.SetFloatingBaseBodyPoseInWorldFrame(
        context, body, RigidTransform(R_WO, [0.003, 0.004, z])
    )
    times, speeds, positions = [], [], []
    failed = False
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
    position = np.array(positions)
    rose = bool(position[:, 2].max() > position[0, 2] + _RISE)
    return Motion(
        time=np.array(times),
        speed=np.array(speeds),
        position=position,
        sunk=-float(min((X_WO @ corner)[2] for corner in corners)),
        exploded=rose or failed,
        wall=elapsed,
    )


def tipping_angle(config: ObjectConfig, pose: str) -> float:
    """Return the angle by which an object in a pose can tip without falling [rad].

    A pose that is tipped is judged as the one that it is tipped from. The object counts
    as a box.
    """
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    index = object_body(plant, AddObject(plant, "thing", config))
    assert isinstance(index, BodyIndex)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    corners = body_corners(plant, inspector, plant.get_body(index))
    roll = np.round(POSES[pose][0] / (np.pi / 2)) * np.pi / 2
    extent = np.ptp(corners @ RotationMatrix.MakeXRotation(roll).matrix().T, axis=0)
    return float(np.arctan2(min(extent[:2]), extent[2]))


def _AddTable(plant: MultibodyPlant, settings: Settings) -> None:
    """Add a table whose top is z = 0."""
    low, high = (-_HALF, -_HALF, -_THICKNESS), (_HALF, _HALF, 0.0)
    shape: Shape = Box(2 * _HALF, 2 * _HALF, _THICKNESS)
    X_WT = RigidTransform([0.0, 0.0, -0.5 * _THICKNESS])
    if settings.cell:
        text = obj_text(*slab_mesh(low, high, settings.cell))
        file = MemoryFile(text, ".obj", "table_top")
        shape, X_WT = Mesh(InMemoryMesh(mesh_file=file)), RigidTransform()
    d = settings.mat_dissipation if settings.mat else 0.0
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=d,
        friction=CoulombFriction(_FRICTION, _FRICTION),
        properties=properties,
    )
    properties.AddProperty("material", "relaxation_time", relaxation_time(d))
    if settings.mat:
        AddCompliantHydroelasticProperties(
            resolution_hint=_HALF,  # a box ignores it
            hydroelastic_modulus=settings.mat,
            properties=properties,
        )
    else:
        AddRigidHydroelasticProperties(properties)
    plant.RegisterCollisionGeometry(
        plant.world_body(), X_WT, shape, "table_top", properties
    )
