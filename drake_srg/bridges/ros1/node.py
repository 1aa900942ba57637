"""A ROS 1 node: known to the master, asked by other nodes."""

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
from drake_srg.bridges.ros1.xmlrpc import XmlRpcError, call, serve

# Between looks whether the master still knows us [s, real].
_POLL_PERIOD = 1.0
# For all goodbyes together [s, real].
_GOODBYE_TIMEOUT = 0.5
# The master is looked up whatever becomes of the hosts of peers.
_resolver = Resolver()


class Ros1Node:
    """A node that publishes and subscribes; it lives in an asyncio loop.

    It waits for its master, and registers again when there is a new one.

    Args:
        name: As in "/drake_srg".
        master: URI, as in "http://localhost:11311".
        host: Address or network interface of this machine; it listens there, and
            peers are told its address.
        publications: What it publishes.
        subscriptions: What it subscribes to.
        warnings: Hears of trouble.

    Raises:
        ValueError: If `master` or `host` cannot be.
        OSError: If nothing can be listened to at `host`.
    """

    def __init__(
        self,
        name: str,
        master: str,
        host: str,
        publications: Sequence[Publication],
        subscriptions: Sequence[Subscription],
        warnings: Warnings,
    ):
        _check_uri(master)
        host = own_address(host)
        self.master = master
        self.registered = False
        self.closed = False
        self._name, self._warnings = name, warnings
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
            self._be_shut_down,
        )

    async def start(self, timeout: float) -> None:
        """Listen to peers, and look for the master from now on.

        Args:
            timeout: How long to wait until it is registered for the first time, or the
                master is not there [s, real].
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
        """Say goodbye to the master and all peers."""
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
                    timeout=_GOODBYE_TIMEOUT,
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
        """Register whenever the master does not know us; tell of the first try."""
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
                    "ROS 1 master", f"ROS 1: roscore {error}; waiting for it"
                )
            tried.set()
            await asyncio.sleep(_POLL_PERIOD)

    async def _register(self) -> None:
        for topic, publication in self._publications.items():
            await self._call(
                "registerPublisher", topic, publication.type.name, self.uri
            )
        for topic, subscription in self._subscriptions.items():
            updates, type = subscription.updates, subscription.type.name
            peers = await self._call("registerSubscriber", topic, type, self.uri)
            # Else the master has told of newer ones while its answer was on the way.
            if subscription.updates == updates:
                subscription.update(map(str, peers))

    async def _call(self, method: str, *arguments: Any) -> Any:
        return await call(
            self.master, method, self._name, *arguments, resolver=_resolver
        )

    def _connect(self) -> SubscriberConnection:
        return SubscriberConnection(
            self._name, self._publications, self._connections, self._warnings
        )

    def _refuse(self, reason: str) -> None:
        self._warnings.warn("ROS 1 request", f"ROS 1: a request is refused: {reason}")

    def _be_shut_down(self, reason: str) -> None:
        self._warnings.warn("ROS 1 shutdown", f"ROS 1: told to shut down ({reason})")
        self._goodbye = asyncio.create_task(self.close())


def _check_uri(uri: str) -> None:
    """Raise a ValueError unless it is of a master."""
    try:
        address = urlsplit(uri)
        good = address.scheme == "http" and address.hostname and address.port
    except ValueError:  # of a port that is none
        good = False
    if not good:
        raise ValueError(
            f"ROS 1 master is {uri!r}; allowed is http://HOST:PORT, as in "
            "http://localhost:11311"
        )
