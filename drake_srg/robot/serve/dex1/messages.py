"""DDS types of the hand's topics, with the names and members of Unitree's SDK."""

from typing import Any

from drake_srg.common.installing import require

require("cyclonedds", "ros2", "the hand's topics need")

from cyclonedds import idl  # noqa: E402 # after the check above

types: Any = idl.types  # mypy does not understand its generic aliases


def _struct(name: str, **members: Any) -> Any:
    package = "std_msgs" if name == "String_" else "unitree_go"
    return idl.make_idl_struct(name, f"{package}.msg.dds_.{name}", members)


MotorCmd = _struct(
    "MotorCmd_",
    mode=types.uint8,
    **dict.fromkeys(("q", "dq", "tau", "kp", "kd"), types.float32),
    reserve=types.array[types.uint32, 3],
)
MotorCmds = _struct("MotorCmds_", cmds=types.sequence[MotorCmd])
_MEASURED = ("q", "dq", "ddq", "tau_est", "q_raw", "dq_raw", "ddq_raw")
MotorState = _struct(
    "MotorState_",
    mode=types.uint8,
    **dict.fromkeys(_MEASURED, types.float32),
    temperature=types.uint8,
    lost=types.uint32,
    reserve=types.array[types.uint32, 2],
)
MotorStates = _struct("MotorStates_", states=types.sequence[MotorState])
String = _struct("String_", data=str)
