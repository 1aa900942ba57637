import asyncio
import contextlib
import socket

import pytest

from drake_srg.robot.serve.ros1.xmlrpc import XmlRpcError, call
from robot.serve.ros1.peers import Api


def run_call(uri, method, *arguments, timeout=20.0):
    return asyncio.run(call(uri, method, *arguments, timeout=timeout))


@pytest.fixture
def new_api():
    """A function that starts an XML-RPC server with methods and returns its URI."""
    with contextlib.ExitStack() as stack:

        def new_api(**methods):
            return stack.enter_context(contextlib.closing(Api(**methods))).uri

        yield new_api


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ([-1, "unknown node", ""], "reports an error: 'unknown node'"),
        ([0, "failed", ""], "reports an error: 'failed'"),
        ([1, "too short"], "invalid answer"),
        (7, "invalid answer"),
    ],
)
def test_a_bad_answer_is_an_error(new_api, answer, words):
    with pytest.raises(XmlRpcError, match=words):
        run_call(new_api(ask=lambda caller: answer), "ask", "/me")


@pytest.mark.parametrize(
    "answer",
    [
        b"HTTP/1.0 200 OK\r\nContent-Length: 3\r\n\r\n<<<",
        b"HTTP/1.0 200 OK\r\nContent-Length: 9999999\r\n\r\n",
        b"SSH-2.0-OpenSSH_9.2\r\n",
    ],
)
def test_a_peer_that_is_not_xml_rpc_is_an_error(answer):
    async def main():
        async def handle(reader, writer):
            await reader.readuntil(b"\r\n\r\n")
            writer.write(answer)
            writer.close()

        server = await asyncio.start_server(handle, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        async with server:
            uri = f"http://127.0.0.1:{port}"
            await call(uri, "getPid", "/me", timeout=20.0)

    with pytest.raises(XmlRpcError, match="invalid answer"):
        asyncio.run(main())


def test_an_unknown_host_is_an_error(monkeypatch):
    def getaddrinfo(*_):
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", getaddrinfo)
    with pytest.raises(XmlRpcError, match="http://robot:11311: host not found"):
        run_call("http://robot:11311", "getPid", "/me")


def test_a_peer_that_is_not_there_does_not_answer():
    with pytest.raises(XmlRpcError, match=r"http://127\.0\.0\.1:9 does not answer"):
        run_call("http://127.0.0.1:9", "getPid", "/me")


def test_a_hanging_peer_does_not_answer_in_time():
    with socket.create_server(("127.0.0.1", 0)) as hanging:
        uri = f"http://127.0.0.1:{hanging.getsockname()[1]}"
        with pytest.raises(XmlRpcError, match="does not answer"):
            run_call(uri, "getPid", "/me", timeout=0.1)
