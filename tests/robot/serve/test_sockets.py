import asyncio
import re
import socket
import subprocess
import sys
import threading

import pytest

from drake_srg.robot.serve import sockets
from drake_srg.robot.serve.sockets import IoThread, address_of, own_address


@pytest.mark.parametrize("host", ["127.0.0.1", "lo", "localhost"])
def test_loopback_is_found_by_address_interface_and_name(host):
    assert own_address(host) == "127.0.0.1"


@pytest.mark.parametrize(
    "host",
    [
        *("", "0.0.0.0", "::", "::1", "*", "nothing", "a b", "x" * 300),
        *("198.51.100.1", "224.0.0.1", "255.255.255.255", "127.0.0.1:80"),
    ],
)
def test_a_host_that_is_not_this_machine_is_refused(host, monkeypatch):
    lookup = socket.gethostbyname

    def look_up_without_servers(name):  # name servers would slow the test down
        if name == "nothing":
            raise socket.gaierror(-2, "Name or service not known")
        return lookup(name)

    monkeypatch.setattr(socket, "gethostbyname", look_up_without_servers)
    message = f"host: must be an IPv4 address .*lo.*, got {re.escape(repr(host))}$"
    with pytest.raises(ValueError, match=message):
        own_address(host)


def test_addresses_of_names_and_addresses_are_found():
    async def look_up():
        for name, address in (
            ("localhost", "127.0.0.1"),
            ("192.0.2.1", "192.0.2.1"),
            ("::1", "::1"),
        ):
            assert await address_of(name) == address
        for name, error in ("a b", OSError), ("x" * 300, UnicodeError):
            with pytest.raises(error):
                await address_of(name)

    asyncio.run(look_up())


def test_a_hanging_lookup_takes_one_thread_and_delays_nobody(hanging_names):
    async def look_up():
        for _ in range(3):
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(address_of("robot"), 0.05)
        assert await address_of("localhost") == "127.0.0.1"

    asyncio.run(look_up())
    assert hanging_names.pending == ["robot"]  # nobody waited for it


def test_few_hosts_are_looked_up_at_a_time(hanging_names, monkeypatch):
    monkeypatch.setattr(sockets, "_lookups", {})

    async def look_up():
        for _ in range(2):  # each makes room for the next
            assert await address_of("localhost", most=1) == "127.0.0.1"
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(address_of("robot"), 0.05)
        with pytest.raises(OSError, match="too many pending host lookups"):
            await address_of("localhost", most=1)
        assert await address_of("localhost") == "127.0.0.1"  # without a limit

    asyncio.run(look_up())
    assert hanging_names.pending == ["robot"]


def test_a_process_exits_without_waiting_for_its_resolver():
    program = """
import asyncio, contextlib, socket, time
from drake_srg.robot.serve.sockets import address_of
socket.getaddrinfo = lambda *_: time.sleep(60.0)
async def main():
    with contextlib.suppress(asyncio.TimeoutError):
        await asyncio.wait_for(address_of("robot"), 0.1)
asyncio.run(main())
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=20.0)


@pytest.fixture
def io():
    thread = IoThread("test")
    yield thread
    thread.stop()


async def _name():
    return threading.current_thread().name


def test_a_call_that_times_out_leaves_the_thread_running(io):
    with pytest.raises(TimeoutError):
        io.call(asyncio.sleep(3600.0), timeout=0.05)
    assert io.call(_name()) == "test"


def test_stop_cancels_running_tasks_and_may_be_repeated(io):
    started, ended = threading.Event(), threading.Event()

    async def forever():
        started.set()
        try:
            await asyncio.sleep(3600.0)
        finally:
            ended.set()

    io.post(io.loop.create_task, forever())
    assert started.wait(20.0)
    io.stop()
    io.stop()
    assert ended.is_set()
