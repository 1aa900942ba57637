"""ROS 2's message types for Cyclone DDS, with their contents serialised by rosbags."""

from __future__ import annotations

from typing import Any

from cyclonedds import idl
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

types: Any = idl.types  # mypy does not understand its generic aliases

# By rosbags' names. byte and char are uint8 on the wire, as in rmw_cyclonedds_cpp.
_PRIMITIVES: dict[str, Any] = {
    "bool": bool,
    "byte": types.uint8,
    "char": types.uint8,
    "int8": types.int8,
    "int16": types.int16,
    "int32": types.int32,
    "int64": types.int64,
    "uint8": types.uint8,
    "uint16": types.uint16,
    "uint32": types.uint32,
    "uint64": types.uint64,
    "float32": types.float32,
    "float64": types.float64,
    "string": str,
}


def type_name(message: str) -> str:
    """Return a message type's name on the wire.

    For `std_msgs/msg/Int32` it is `std_msgs::msg::dds_::Int32_`.
    """
    package, kind, name = message.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def topic_name(name: str) -> str:
    """Return the DDS topic of a ROS topic; without a slash, a name is DDS's already."""
    return f"rt{name}" if name.startswith("/") else name


def payload_type(store: Typestore, message: str) -> Any:
    """Return a DDS type whose samples hold a message in serialised form.

    The type describes the message's structure to DDS. A sample is constructed from the
    bytes of rosbags' `serialize_cdr` and keeps them in its attribute `cdr`. (Cyclone's
    own serialiser takes tens of ms for an image of 640 x 480, rosbags' 0.2 ms.)

    Args:
        store: Has the message's definition.
        message: Message type, such as "std_msgs/msg/Int32".
    """
    cls = _struct(store, message, dataclassify=False)
    # Not inherited, because members of a base class would be members on the wire.
    cls.__init__ = _init
    cls.serialize = lambda self, **_: self.cdr
    cls.deserialize = cls.deserialize_key = classmethod(
        lambda cls, data, **_: cls(data)
    )
    return cls


def _init(self: Any, cdr: bytes) -> None:
    self.cdr = cdr


def _struct(store: Typestore, message: str, **options: Any) -> Any:
    _, fields = store.fielddefs[message]
    name = type_name(message)
    members = {field: _type(store, kind) for field, kind in fields}
    return idl.make_idl_struct(name.rpartition(":")[2], name, members, **options)


def _type(store: Typestore, field: Any) -> Any:
    kind, detail = field
    if kind == Nodetype.NAME:
        return _struct(store, detail)
    content, size = detail
    if kind == Nodetype.BASE:
        bounded = content == "string" and size
        return types.bounded_str[size] if bounded else _PRIMITIVES[content]
    element = _type(store, content)
    if kind == Nodetype.ARRAY:
        return types.array[element, size]
    return types.sequence[element, size] if size else types.sequence[element]
