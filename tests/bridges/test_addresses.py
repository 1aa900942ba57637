import asyncio
import contextlib
import re
import socket
import subprocess
import sys
import threading
import time

import pytest

from drake_srg.bridges.addresses import Resolver, own_address


@pytest.mark.parametrize("host", ["127.0.0.1", "lo", "localhost"])
def test_the_loopback_interface_by_address_and_names(host):
    assert own_address(host) == "127.0.0.1"


@pytest.mark.parametrize(
    "host",
    [
        *("", "0.0.0.0", "::", "::1", "*", "nothing", "a b", "x" * 300),
        *("198.51.100.1", "224.0.0.1", "255.255.255.255", "127.0.0.1:80"),
    ],
)
def test_what_is_no_address_of_this_machine(host, monkeypatch):
    lookup = socket.gethostbyname

    def numbers_alone(name):  # no test waits for name servers
        if name == "nothing":
            raise socket.gaierror(-2, "Name or service not known")
        return lookup(name)

    monkeypatch.setattr(socket, "gethostbyname", numbers_alone)
    message = f"host is {re.escape(repr(host))}; allowed is one IPv4 address .*: .*lo"
    with pytest.raises(ValueError, match=message):
        own_address(host)


@pytest.fixture
def names(monkeypatch):
    """A resolver of the system that gives up no robot until the end of the test."""
    given_up, asked = threading.Event(), []
    real = socket.getaddrinfo

    def getaddrinfo(host, *arguments, **options):
        asked.append(host)
        if str(host).startswith("robot"):
            given_up.wait(20.0)
            raise socket.gaierror(-3, "Temporary failure in name resolution")
        return real(host, *arguments, **options)

    monkeypatch.setattr(socket, "getaddrinfo", getaddrinfo)
    yield asked
    given_up.set()


def test_names_and_addresses():
    async def look_up():
        resolver = Resolver()
        assert await resolver.address("localhost") == "127.0.0.1"
        assert await resolver.address("192.0.2.1") == "192.0.2.1"
        assert await resolver.address("::1") == "::1"
        for name, error in ("a b", OSError), ("x" * 300, UnicodeError):
            with pytest.raises(error):
                await resolver.address(name)
        assert resolver._running == {}

    asyncio.run(look_up())


def test_a_host_that_is_not_found_costs_one_thread_and_nobody_time(names):
    async def look_up():
        resolver = Resolver(limit=2)
        for _ in range(3):
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(resolver.address("robot"), 0.05)
        assert names == ["robot"]
        assert await resolver.address("localhost") == "127.0.0.1"
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(resolver.address("robot2"), 0.05)
        with pytest.raises(OSError, match="too many hosts"):
            await resolver.address("localhost")

    start = time.monotonic()
    asyncio.run(look_up())
    assert time.monotonic() - start < 2.0


def test_the_process_does_not_wait_for_the_resolver_at_its_end():
    program = """
import asyncio, contextlib, socket, time
from drake_srg.bridges.addresses import Resolver
socket.getaddrinfo = lambda *_: time.sleep(60.0)
async def main():
    with contextlib.suppress(asyncio.TimeoutError):
        await asyncio.wait_for(Resolver().address("robot"), 0.1)
asyncio.run(main())
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=20.0)
