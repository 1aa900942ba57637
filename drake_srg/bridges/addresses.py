"""Addresses of this machine, and of others by their names."""

from __future__ import annotations

import asyncio
import fcntl
import ipaddress
import socket
import struct
import threading
from concurrent.futures import Future

# ioctl that tells an interface's IPv4 address. Source: linux/sockios.h.
_SIOCGIFADDR = 0x8915


def own_address(host: str) -> str:
    """Return the IPv4 address of this machine that somebody means.

    Args:
        host: Such an address, a name that has one, or a network interface.

    Raises:
        ValueError: If this machine has no such address, or it is that of all.
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
    except (OSError, ValueError):  # ValueError: of a name that cannot be one
        good = False
    if not good:
        raise ValueError(
            f"host is {host!r}; allowed is one IPv4 address of this machine that peers "
            f"reach, or an interface that has one: {', '.join(interfaces)}"
        )
    return str(address)


def _interface_address(name: str) -> str:
    with socket.socket() as any_socket:
        request = struct.pack("256s", name.encode())
        answer = fcntl.ioctl(any_socket.fileno(), _SIOCGIFADDR, request)
    return socket.inet_ntoa(answer[20:24])  # behind the name's 16 bytes, in a sockaddr


class Resolver:
    """Looks up hosts' addresses, with no thread that could keep others waiting.

    The system's resolver may take half a minute to give up a name, and cannot be told
    to stop. (The threads that asyncio has for it are few, and the process waits for
    them at its end.)

    Args:
        limit: Hosts that are looked up at once.
    """

    def __init__(self, limit: int = 16):
        self._limit = limit
        self._lock = threading.Lock()
        self._running: dict[str, Future[str]] = {}

    async def address(self, host: str) -> str:
        """Return a host's address.

        Raises:
            OSError: If it has none, or too many hosts are being looked up.
            UnicodeError: If its name cannot be one.
        """
        try:
            return str(ipaddress.ip_address(host))
        except ValueError:
            return await asyncio.wrap_future(self._look_up(host))

    def _look_up(self, host: str) -> Future[str]:
        with self._lock:
            if host not in self._running:
                if len(self._running) >= self._limit:
                    raise OSError("too many hosts are being looked up")
                future: Future[str] = Future()
                future.set_running_or_notify_cancel()  # who waits cannot cancel it
                self._running[host] = future
                threading.Thread(
                    target=self._run, args=(host, future), name="resolver", daemon=True
                ).start()
            return self._running[host]

    def _run(self, host: str, future: Future[str]) -> None:
        try:
            # IPv4, as ROS 1 unless it is told otherwise.
            found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM)
            address = str(found[0][4][0])
        except Exception as error:  # whatever it is, somebody else waits for it
            self._end(host)
            future.set_exception(error)
        else:
            self._end(host)
            future.set_result(address)

    def _end(self, host: str) -> None:
        with self._lock:
            del self._running[host]
