"""Calls of ROS 2 services that nobody waits for."""

from __future__ import annotations

import itertools
import secrets
import threading
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

from drake_srg.bridges.ros2.follow_joint_trajectory import Service
from drake_srg.hardware.nodes import Node
from drake_srg.recording.ros_topics import MakeMessage, Topic

# Calls that may be without a reply; beyond that, the oldest are forgotten.
_MOST_CALLS = 200

_T = TypeVar("_T")
# Returns the fields of a request, given what `call` is given.
Fill = Callable[..., Mapping[str, Any]]


class ServiceClient(Generic[_T]):
    """A client of a service, whose replies arrive in a thread of its node.

    Args:
        node: The node; not yet open.
        service: The service.
        fill: Called as `fill(make, *values)`.
        receive: Called with what a call was about, and the reply.
    """

    def __init__(
        self,
        node: Node,
        service: Service,
        fill: Fill,
        receive: Callable[[_T, Any], None],
    ) -> None:
        self._id = secrets.randbits(64)
        self._numbers = itertools.count(1)
        self._node, self._receive = node, receive
        self._lock = threading.Lock()
        self._calls: dict[int, _T] = {}

        def convert(make: MakeMessage, time: float, number: int, *values: Any) -> Any:
            fields = fill(make, *values)
            return make(service.request_type, client=self._id, number=number, **fields)

        self._topic = Topic(service.request, service.request_type, {}, convert)
        node.publish(self._topic)
        node.subscribe(service.reply, service.reply_type, self._take)

    @property
    def there(self) -> bool:
        """Whether a server listens."""
        return self._node.has_subscribers(self._topic.name)

    def call(self, about: _T, *values: Any) -> None:
        """Send a request.

        Args:
            about: Handed to `receive` with the reply.
            values: Handed to `fill`.
        """
        with self._lock:
            number = next(self._numbers)
            self._calls[number] = about
            while len(self._calls) > _MOST_CALLS:
                del self._calls[next(iter(self._calls))]
        self._node.send(self._topic, 0.0, number, *values)

    def _take(self, reply: Any) -> None:
        if reply.client != self._id:
            return
        with self._lock:
            about = self._calls.pop(reply.number, None)
        if about is not None:
            self._receive(about, reply)
