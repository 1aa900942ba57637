"""A ROS 1 node: registers at the master and answers other nodes."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Sequence
from typing import Any
from urllib.parse import urlsplit

from drake_srg.bridges.addresses import Resolver, own_address
from drake_srg.bridges.commands import Warnings
from drake_srg.bridges.ros1.publication import Publication, SubscriberConnection
from drake_srg.bridges.ros1.slave import SlaveApi
from drake_srg.bridges.ros1.subscription import Subscription
from drake_srg.bridges.ros1.timing import Timing
from drake_srg.bridges.ros1.xmlrpc import XmlRpcError, call, serve

# Separate from the resolver of publishers' hosts, so that hanging lookups of those
# never keep the node from its master.
_resolver = Resolver()


class Ros1Node:
    """A node that publishes and subscribes in an asyncio loop.

    It waits for its master, and registers again when the master has restarted.

    Args:
        name: The node's name, such as "/drake_srg".
        master: The master's URI, such as "http://localhost:11311".
        host: Address or network interface of this machine. The node listens there and
            gives its address to peers.
        publications: The topics to publish.
        subscriptions: The topics to subscribe to.
        warnings: Where trouble is reported.
        timing: Waiting times.

    Attributes:
        master: The argument.
        uri: The node's own URI.
        registered: Whether the master knows the node.
        closed: Whether the node has shut down.

    Raises:
        ValueError: If `master` or `host` is invalid.
        OSError: If the node cannot listen at `host`.
    """

    def __init__(
        self,
        name: str,
        master: str,
        host: str,
        publications: Sequence[Publication],
        subscriptions: Sequence[Subscription],
        warnings: Warnings,
        timing: Timing,
    ):
        _check_uri(master)
        host = own_address(host)
        self.master = master
        self.registered = False
        self.closed = False
        self._name, self._warnings, self._timing = name, warnings, timing
        self._publications = {p.topic: p for p in publications}
        self._subscriptions = {s.topic: s for s in subscriptions}
        self._connections: set[SubscriberConnection] = set()
        self._servers: list[asyncio.Server] = []
        self._tasks: list[asyncio.Task[None]] = []
        with contextlib.ExitStack() as stack:
            self._listeners = [
                stack.enter_context(socket.create_server((host, 0))) for _ in range(2)
            ]
            stack.pop_all()
        slave, tcpros = (listener.getsockname()[1] for listener in self._listeners)
        self.uri = f"http://{host}:{slave}/"
        self._api = SlaveApi(
            master,
            (host, tcpros),
            self._publications,
            self._subscriptions,
            self._shut_down,
        )

    async def start(self, timeout: float) -> None:
        """Listen to peers, and start to look for the master.

        Args:
            timeout: How long to wait for the first attempt to register, successful or
                not [s, real].
        """
        slave, tcpros = self._listeners
        loop = asyncio.get_running_loop()
        self._servers.append(await serve(slave, self._api.answer, self._refuse))
        self._servers.append(await loop.create_server(self._connect, sock=tcpros))
        tried = asyncio.Event()
        self._tasks.append(asyncio.create_task(self._stay_registered(tried)))
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(tried.wait(), timeout)

    async def close(self) -> None:
        """Unregister at the master and disconnect all peers."""
        if self.closed:
            return
        self.closed, self.registered = True, False
        for task in self._tasks:
            task.cancel()
        for subscription in self._subscriptions.values():
            subscription.close()
        for server in self._servers:
            server.close()
        for listener in self._listeners:
            listener.close()
        for connection in list(self._connections):
            connection.abort()
        await asyncio.gather(
            *(
                call(
                    self.master,
                    f"unregister{kind}",
                    self._name,
                    topic,
                    self.uri,
                    resolver=_resolver,
                    timeout=self._timing.goodbye,
                )
                for kind, topics in (
                    ("Publisher", self._publications),
                    ("Subscriber", self._subscriptions),
                )
                for topic in topics
            ),
            return_exceptions=True,
        )

    async def _stay_registered(self, tried: asyncio.Event) -> None:
        """Register whenever the master does not know the node.

        Sets `tried` after the first attempt.
        """
        while True:
            try:
                if self.registered:
                    await self._call("lookupNode", self._name)
            except XmlRpcError:
                self.registered = False
            try:
                if not self.registered:
                    await self._register()
                    self.registered = True
                    self._warnings.forget("ROS 1 master")
            except (XmlRpcError, TypeError) as error:
                self._warnings.warn(
                    "ROS 1 master", f"ROS 1: roscore: {error}; waiting for it"
                )
            tried.set()
            await asyncio.sleep(self._timing.poll)

    async def _register(self) -> None:
        for topic, publication in self._publications.items():
            await self._call(
                "registerPublisher", topic, publication.type.name, self.uri
            )
        for topic, subscription in self._subscriptions.items():
            updates, type = subscription.updates, subscription.type.name
            peers = await self._call("registerSubscriber", topic, type, self.uri)
            # Otherwise the master has sent a newer list while its answer was on the
            # way.
            if subscription.updates == updates:
                subscription.update(map(str, peers))

    async def _call(self, method: str, *arguments: Any) -> Any:
        return await call(
            self.master, method, self._name, *arguments, resolver=_resolver
        )

    def _connect(self) -> SubscriberConnection:
        return SubscriberConnection(
            self._name,
            self._publications,
            self._connections,
            self._warnings,
            self._timing,
        )

    def _refuse(self, reason: str) -> None:
        self._warnings.warn("ROS 1 request", f"ROS 1: refused a request: {reason}")

    def _shut_down(self, reason: str) -> None:
        self._warnings.warn("ROS 1 shutdown", f"ROS 1: told to shut down ({reason})")
        self._goodbye = asyncio.create_task(self.close())


def _check_uri(uri: str) -> None:
    """Raise a ValueError unless a URI can be a master's."""
    try:
        address = urlsplit(uri)
        good = address.scheme == "http" and address.hostname and address.port
    except ValueError:  # an invalid port
        good = False
    if not good:
        raise ValueError(
            "ROS 1 master: must be http://HOST:PORT, such as http://localhost:11311, "
            f"got {uri!r}"
        )
