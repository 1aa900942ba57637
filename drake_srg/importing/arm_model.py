"""An arm's SDF file, with convex pieces, motors and ignored contacts."""

from __future__ import annotations

import itertools
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.random import default_rng
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from drake_srg import parsing
from drake_srg.importing.arm_file import ArmFile, ArmJoint, ArmLink
from drake_srg.objects.meshes.convert import (
    AddMesh,
    AddPrimitive,
    AddVisuals,
    MeshReader,
)
from drake_srg.objects.meshes.files import MeshFile, require_trimesh
from drake_srg.objects.meshes.pieces import decimated
from drake_srg.objects.sdf import (
    DRAKE,
    PROXIMITY,
    AddChild,
    AddContact,
    AddInertial,
    AddPose,
)

# The frames that scenarios weld, to the ground and to the gripper.
BASE, FLANGE = "link_0", "flange"
# Assumed ratio of a joint's torque limit to the reflected inertia of its motor and gear
# [rad/s²]. It is 95 in our iiwa's model and 62 in the hobby arm's.
EFFORT_PER_INERTIA = 100.0
_FRICTION = 0.4  # of painted metal, as in our iiwa's model
# Contacts of two links are ignored if they touch in none of this number of random
# postures, or in at least this share of them.
_SAMPLES, _ALWAYS = 10_000, 0.95
_TWO_TURNS = 2.0 * np.pi


def write_model(arm: ArmFile, path: Path) -> list[str]:
    """Write the model of an arm, and its meshes beside it.

    Each collision mesh becomes its convex hull. Links keep their names, and bodies that
    are fixed to them become frames with their names.

    Args:
        arm: The arm.
        path: The model's file, in an empty folder.

    Returns:
        The ignored pairs of links in words, without neighbours.
    """
    root = ET.Element("sdf", {"version": "1.9"})
    model = AddChild(root, "model", name="arm")
    names = [link.name for link in arm.links]
    joints = [None, *arm.joints]
    for i, (link, joint) in enumerate(zip(arm.links, joints, strict=True)):
        node = AddChild(model, "link", name=link.name)
        if joint is not None:
            _AddRelativePose(node, joint.X_PC, names[i - 1])
        _AddContents(node, link, path.parent)
        if joint is not None:
            _AddJoint(model, joint, names[i - 1], link.name)
    frames = {
        **{name: (link, X) for link in arm.links for name, X in link.frames.items()},
        BASE: (arm.links[0], RigidTransform()),
        FLANGE: (arm.links[-1], arm.X_LT),
    }
    for name, (link, X_LF) in frames.items():
        if name not in names:
            frame = AddChild(model, "frame", name=name, attached_to=link.name)
            AddPose(frame, X_LF.translation(), _rpy(X_LF))
    _write(root, path)
    ignored = _ignored_pairs(path, names, arm.joints)
    for i, pair in enumerate(ignored):
        group = AddChild(
            model, f"{{{DRAKE}}}collision_filter_group", name=f"ignored_{i}"
        )
        for name in pair:
            AddChild(group, f"{{{DRAKE}}}member", name)
        AddChild(group, f"{{{DRAKE}}}ignored_collision_filter_group", f"ignored_{i}")
    _write(root, path)
    return [f"{first} and {second}" for first, second in ignored]


def _write(root: ET.Element, path: Path) -> None:
    ET.indent(root, "  ")
    text = ET.tostring(root, encoding="unicode")
    path.write_text(text + "\n", encoding="utf-8")


def _rpy(X: RigidTransform) -> Sequence[float]:
    return list(RollPitchYaw(X.rotation()).vector())


def _AddRelativePose(link: ET.Element, X_PC: RigidTransform, parent: str) -> None:
    values = [*X_PC.translation(), *_rpy(X_PC)]
    AddChild(link, "pose", values, relative_to=parent)


def _AddContents(node: ET.Element, link: ArmLink, folder: Path) -> None:
    contents, nowhere = link.contents, np.zeros(3)
    assert contents.inertia is not None
    AddInertial(node, contents.inertia)
    reader, plain = MeshReader(contents.warnings), re.sub(r"\W+", "_", link.name)
    AddVisuals(node, contents, reader, nowhere, folder, f"{plain}_visual")
    for i, geometry in enumerate(contents.collisions):
        name = f"{plain}_{i}"
        collision = AddChild(node, "collision", name=name)
        if isinstance(geometry.shape, MeshFile):
            corners = decimated(np.asarray(reader.solid(geometry).vertices))
            hull = require_trimesh().convex.convex_hull(corners)
            mesh = AddMesh(collision, folder / f"{name}.obj", hull)
            AddChild(mesh, f"{{{DRAKE}}}declare_convex")
        else:
            AddPrimitive(collision, geometry.shape, geometry.X_LG, nowhere)
        AddContact(collision, own=_contact())


def _contact() -> ET.Element:
    node = ET.Element(PROXIMITY)
    AddChild(node, f"{{{DRAKE}}}rigid_hydroelastic")
    for tag, value in (
        ("mesh_resolution_hint", 0.05),
        ("relaxation_time", 0.0),
        ("mu_dynamic", _FRICTION),
        ("mu_static", _FRICTION),
    ):
        AddChild(node, f"{{{DRAKE}}}{tag}", value)
    return node


def _AddJoint(model: ET.Element, joint: ArmJoint, parent: str, child: str) -> None:
    node = AddChild(model, "joint", name=joint.name, type=joint.kind)
    AddPose(node, joint.X_CJ.translation(), _rpy(joint.X_CJ))
    AddChild(node, "parent", parent)
    AddChild(node, "child", child)
    axis = AddChild(node, "axis")
    AddChild(axis, "xyz", joint.axis)
    limit = AddChild(axis, "limit")
    for tag, value in (("lower", joint.lower), ("upper", joint.upper)):
        if np.isfinite(value):
            AddChild(limit, tag, value)
    AddChild(limit, "effort", joint.effort)
    AddChild(limit, "velocity", joint.velocity)
    AddChild(limit, f"{{{DRAKE}}}acceleration", joint.acceleration)
    AddChild(AddChild(axis, "dynamics"), "damping", joint.damping)
    inertia = joint.effort / EFFORT_PER_INERTIA
    AddChild(node, f"{{{DRAKE}}}rotor_inertia", inertia)
    AddChild(node, f"{{{DRAKE}}}gear_ratio", 1.0)


def _ignored_pairs(
    path: Path, links: Sequence[str], joints: Sequence[ArmJoint]
) -> list[tuple[str, str]]:
    """Return pairs of links that touch in nearly all random postures, or in none.

    Neighbours are left out, because Drake ignores their contacts anyway.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    model = parsing.AddModel(plant, path)
    base = plant.GetBodyByName(links[0], model).body_frame()
    plant.WeldFrames(plant.world_frame(), base)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    scene_context = scene_graph.GetMyContextFromRoot(context)
    port, inspector = scene_graph.get_query_output_port(), scene_graph.model_inspector()
    lower = np.array([max(joint.lower, -_TWO_TURNS) for joint in joints])
    upper = np.array([min(joint.upper, _TWO_TURNS) for joint in joints])
    random, touched = default_rng(0), Counter[tuple[str, str]]()
    for _ in range(_SAMPLES):
        plant.SetPositions(plant_context, random.uniform(lower, upper))
        found = port.Eval(scene_context).ComputePointPairPenetration()
        pairs = set()
        for contact in found:
            bodies = [
                plant.GetBodyFromFrameId(inspector.GetFrameId(g)).name()
                for g in (contact.id_A, contact.id_B)
            ]
            first, second = sorted(bodies, key=links.index)
            pairs.add((first, second))
        touched.update(pairs)
    return [
        pair
        for pair in itertools.combinations(links, 2)
        if links.index(pair[1]) - links.index(pair[0]) > 1
        and not 0 < touched[pair] < _ALWAYS * _SAMPLES
    ]
