"""XML-RPC for asyncio, the protocol of calls between ROS 1's master and nodes.

The standard library encodes and decodes the messages. Its client and server are not
used, because they wait for slow peers and read messages of any size.
"""

from __future__ import annotations

import asyncio
import re
import socket
import xmlrpc.client
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from drake_srg.common.exceptions import one_line
from drake_srg.robot.serve.sockets import address_of

# Largest request or answer [bytes], as for TCPROS frames.
_LIMIT = 2**20
# Longest time for a call [s, real]. Peers are nearby and answer at once.
TIMEOUT = 2.0

# Returns the result of a method for its arguments; raises a TypeError if it cannot.
Answer = Callable[[str, tuple[Any, ...]], Any]


class XmlRpcError(ConnectionError):
    """A peer does not answer, or its answer violates the protocol."""


async def call(
    uri: str,
    method: str,
    *arguments: Any,
    timeout: float = TIMEOUT,
    lookups: int | None = None,
) -> Any:
    """Call a method of ROS's master or slave API and return the answer's value.

    Args:
        uri: The peer's URI, such as "http://localhost:11311".
        method: The method's name, such as "requestTopic".
        arguments: The method's arguments, the caller's name first.
        timeout: Time for the whole call [s, real].
        lookups: Most simultaneous lookups of hosts; None: no limit.

    Raises:
        XmlRpcError: If the call fails, for any reason.
    """
    request = xmlrpc.client.dumps(arguments, method).encode()
    try:
        body = await asyncio.wait_for(_exchange(uri, request, lookups), timeout)
        answers: Any = xmlrpc.client.loads(body)[0]
        ((code, status, value),) = answers
    except socket.gaierror as error:
        raise XmlRpcError(f"{uri}: host not found") from error
    except (TimeoutError, OSError) as error:
        raise XmlRpcError(f"{uri} does not answer") from error
    except Exception as error:  # parsing arbitrary text can fail in any way
        raise XmlRpcError(f"{uri}: invalid answer: {one_line(error)}") from error
    if code != 1:
        raise XmlRpcError(f"{uri} reports an error: {status!r:.200}")
    return value


async def serve(
    listener: socket.socket, answer: Answer, refuse: Callable[[str], None]
) -> asyncio.Server:
    """Answer calls at a socket until the returned server is closed.

    Args:
        listener: A bound socket, which the server takes over.
        answer: Called for each call; returns its result.
        refuse: Called with the reason when a request is invalid.
    """

    async def handle(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        try:
            request = await asyncio.wait_for(_read(reader), TIMEOUT)
            body = _answer(request, answer)
            writer.write(_message(b"HTTP/1.0 200 OK", body))
            await asyncio.wait_for(writer.drain(), TIMEOUT)
        except TimeoutError:
            refuse("incomplete request")
        except Exception as error:  # parsing arbitrary text can fail in any way
            refuse(one_line(error))
        finally:
            writer.close()

    return await asyncio.start_server(handle, sock=listener)


def _answer(request: bytes, answer: Answer) -> bytes:
    arguments, method = xmlrpc.client.loads(request)
    result: Any
    try:
        result = (answer(str(method), arguments),)
    except TypeError as error:
        result = xmlrpc.client.Fault(1, str(error))
    return xmlrpc.client.dumps(result, methodresponse=True).encode()


async def _exchange(uri: str, request: bytes, lookups: int | None) -> bytes:
    address = urlsplit(uri)
    host = await address_of(address.hostname or "", lookups)
    reader, writer = await asyncio.open_connection(host, address.port)
    try:
        target = f"POST {address.path or '/'} HTTP/1.0\r\nHost: {address.netloc}"
        writer.write(_message(target.encode(), request))
        return await _read(reader)
    finally:
        writer.close()


def _message(start: bytes, body: bytes) -> bytes:
    head = b"%s\r\nContent-Type: text/xml\r\nContent-Length: %d\r\n\r\n"
    return head % (start, len(body)) + body


async def _read(reader: asyncio.StreamReader) -> bytes:
    """Return the body of an HTTP message."""
    head = await reader.readuntil(b"\r\n\r\n")
    length = re.search(rb"\r\ncontent-length: *(\d{1,9})\r", head, re.IGNORECASE)
    if length is None or int(length[1]) > _LIMIT:
        raise ValueError(f"must be an HTTP message of at most {_LIMIT} bytes")
    return await reader.readexactly(int(length[1]))
