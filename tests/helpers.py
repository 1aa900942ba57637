"""One step up the ladder: fix a system's inputs, evaluate ports, fire one event."""

import importlib
import os
import shutil
from pathlib import Path

import numpy as np
import pytest


def fix(system, context, **inputs):
    """Fixes input ports by name, vectors and abstract values alike."""
    for name, value in inputs.items():
        abstract = hasattr(value, "get_value")
        system.GetInputPort(name).FixValue(
            context, value if abstract else np.atleast_1d(value)
        )


def update(system, context, time=None):
    """Executes the system's periodic discrete update once, at `time` if given."""
    if time is not None:
        context.SetTime(time)
    context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))


def read(system, context, name):
    """The value of an output port, a copy of it where it is a vector."""
    value = system.GetOutputPort(name).Eval(context)
    return value.copy() if isinstance(value, np.ndarray) else value


def port_table(system):
    """Name to size of the vector ports, to None of the abstract ones: (in, out)."""

    def size(port):
        return port.size() if port.get_data_type().name == "kVectorValued" else None

    ins = map(system.get_input_port, range(system.num_input_ports()))
    outs = map(system.get_output_port, range(system.num_output_ports()))
    return (
        {port.get_name(): size(port) for port in ins},
        {port.get_name(): size(port) for port in outs},
    )


def needs_debian(*programs):
    """Skip where a program, or a file of an absolute path, is missing.

    With DRAKE_SRG_REQUIRE_PEERS in the environment the test fails instead.
    """
    missing = [p for p in programs if not (shutil.which(p) or Path(p).is_file())]
    if missing:
        _do_without(f"{', '.join(missing)} missing: sh tools/install_test_peers.sh")


def needs_module(name):
    """Import a module; skip, or fail, likewise where it is missing."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        _do_without(f"{name} cannot be imported: {error}")


# Begins the command of a process that is sent SIGINT: what a shell starts in the
# background ignores that, and so does all that this starts.
HEEDING_CTRL_C = ["env", "--default-signal=INT"]


def needs_pty():
    """Skip, or fail, likewise where there are no pseudo terminals, as in a chroot."""
    try:
        ends = os.openpty()
    except OSError as error:
        _do_without(f"no pseudo terminals here: {error}")
    else:
        for end in ends:
            os.close(end)


def _do_without(message):
    if "DRAKE_SRG_REQUIRE_PEERS" in os.environ:
        pytest.fail(message)
    pytest.skip(message)
