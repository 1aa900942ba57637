import numpy as np
from helpers import fix
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex

from drake_srg.objects.poses import ObjectPoses


def poses_of(bodies, poses):
    system = ObjectPoses({name: BodyIndex(i) for name, i in bodies.items()})
    context = system.CreateDefaultContext()
    fix(system, context, body_poses=AbstractValue.Make(poses))
    return system.get_output_port().Eval(context)


def test_poses_are_given_by_name():
    poses = [RigidTransform([x, 0.0, 0.0]) for x in (0.0, 1.0, 2.0)]
    result = poses_of({"cup": 2, "can": 1}, poses)
    assert result.keys() == {"cup", "can"}
    np.testing.assert_array_equal(result["can"].translation(), [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(result["cup"].translation(), [2.0, 0.0, 0.0])


def test_no_objects_have_no_poses():
    assert poses_of({}, [RigidTransform()]) == {}
