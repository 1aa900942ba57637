"""Addresses of hosts, and a thread with an event loop for a bridge's sockets."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import ipaddress
import socket
import struct
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from typing import Any, TypeVar

# ioctl that returns an interface's IPv4 address. Source: linux/sockios.h.
_SIOCGIFADDR = 0x8915


def own_address(host: str) -> str:
    """Return the IPv4 address of this machine that `host` stands for.

    Args:
        host: An address, a host name, or the name of a network interface.

    Raises:
        ValueError: If `host` is not an address of this machine, or stands for all
            addresses.
    """
    interfaces = [name for _, name in socket.if_nameindex()]
    try:
        name = _interface_address(host) if host in interfaces else host
        address = ipaddress.ip_address(socket.gethostbyname(name))
        with socket.socket() as probe:
            probe.bind((str(address), 0))
        good = not (
            address.is_unspecified or address.is_multicast or address.is_reserved
        )
    except (OSError, ValueError):  # ValueError: an invalid name
        good = False
    if not good:
        raise ValueError(
            "host: must be an IPv4 address of this machine that peers can reach, or an "
            f"interface that has one ({', '.join(interfaces)}), got {host!r}"
        )
    return str(address)


def _interface_address(name: str) -> str:
    with socket.socket() as any_socket:
        request = struct.pack("256s", name.encode())
        answer = fcntl.ioctl(any_socket.fileno(), _SIOCGIFADDR, request)
    return socket.inet_ntoa(answer[20:24])  # in the sockaddr after 16 bytes of name


# Most simultaneous lookups of hosts that peers name. Each lookup has a thread.
MOST_LOOKUPS = 16
# Lookups under way, by host.
_lookups: dict[str, Future[str]] = {}


async def address_of(host: str, most: int | None = None) -> str:
    """Return a host's IPv4 address. A slow lookup delays neither others nor exit.

    The system's resolver may take half a minute to give up on a name and cannot be
    interrupted. asyncio runs it in a small thread pool, which the process joins when it
    exits. Here every host gets a daemon thread instead.

    Args:
        host: An address or a name.
        most: Most simultaneous lookups, this one included; None: no limit.

    Raises:
        OSError: If the host has no address, or too many lookups are under way.
        UnicodeError: If the name is invalid.
    """
    with contextlib.suppress(ValueError):
        return str(ipaddress.ip_address(host))
    future = _lookups.get(host)
    if future is None:
        if most is not None and len(_lookups) >= most:
            raise OSError("too many pending host lookups")
        future = _lookups[host] = Future()
        future.set_running_or_notify_cancel()  # no waiter can cancel it
        thread = threading.Thread(target=_look_up, args=(host, future), daemon=True)
        thread.start()
    return await asyncio.wrap_future(future)


def _look_up(host: str, future: Future[str]) -> None:
    # Remove the lookup before anybody learns the result.
    try:
        # IPv4, the default of ROS 1.
        found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM)
    except Exception as error:  # the waiting coroutine gets every error
        _lookups.pop(host, None)
        future.set_exception(error)
    else:
        _lookups.pop(host, None)
        future.set_result(str(found[0][4][0]))


_T = TypeVar("_T")
_PATIENCE = 5.0  # how long to wait for cancelled tasks to end [s]


class IoThread:
    """An asyncio event loop that runs in a thread until it is stopped."""

    def __init__(self, name: str):
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def call(self, coroutine: Coroutine[Any, Any, _T], timeout: float = 5.0) -> _T:
        """Run a coroutine in the thread and return its result.

        Raises:
            TimeoutError: If it takes longer than `timeout` [s]; it is then cancelled.
        """
        future = asyncio.run_coroutine_threadsafe(coroutine, self.loop)
        try:
            return future.result(timeout)
        except TimeoutError:
            future.cancel()
            raise TimeoutError(f"not done within {timeout:g} s") from None

    def post(self, function: Callable[..., object], *arguments: Any) -> None:
        """Schedule a call in the thread, without waiting for it."""
        self.loop.call_soon_threadsafe(function, *arguments)

    def stop(self) -> None:
        """Cancel all tasks and end the thread, or give up after `_PATIENCE`."""
        if self._thread.is_alive():
            self.loop.call_soon_threadsafe(self.loop.stop)
            self._thread.join(_PATIENCE)

    def _run(self) -> None:
        asyncio.set_event_loop(self.loop)
        self.loop.run_forever()
        tasks = asyncio.all_tasks(self.loop)
        for task in tasks:
            task.cancel()
        self.loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        self.loop.close()
