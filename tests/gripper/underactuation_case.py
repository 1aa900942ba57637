"""The underactuation logic, and its inputs."""

import numpy as np
from helpers import fix, read, update
from hypothesis import strategies as st

from drake_srg.gripper.underactuation import UnderactuationConfig, UnderactuationLogic

NAN = np.nan

angle = st.floats(-0.1, 1.94)
closure = st.floats(0.0, 1.0)
four_angles = st.tuples(*[angle] * 4)


def make(closure=0.0, q=(0.0,) * 4, fired=(0.0,) * 4, **config):
    system = UnderactuationLogic(UnderactuationConfig(**config))
    context = system.CreateDefaultContext()
    given_inputs(system, context, closure, q, fired)
    return system, context


def given_inputs(system, context, closure, q, fired):
    fix(
        system,
        context,
        closure_commanded=closure,
        state_measured=np.concatenate([q, np.zeros(4)]),
        triggered=np.array(fired, dtype=float),
    )


def targets(system, context):
    update(system, context)
    return read(system, context, "position_desired")
