"""Peers of a ROS 1 node, of plain sockets and the standard library."""

import socket
import struct
import threading
import time
import xmlrpc.client
from xmlrpc.server import SimpleXMLRPCServer

import numpy as np

from drake_srg.bridges.commands import CommandError, CommandTopic
from drake_srg.recording import ros_topics

# As `rosmsg md5` prints them.
INT32_MD5 = "da5909fbe378aeaf85e547e830cc1bb7"
ARRAY_MD5 = "4b7d974086d4060e7db4613a7e6c3ba4"
CLOCK_MD5 = "a9c97c1d230cfc112e270351a944ee47"

# Headers of publishers.
INT32 = {"callerid": "/peer", "md5sum": INT32_MD5, "type": "std_msgs/Int32"}
ARRAY = {
    "callerid": "/peer",
    "md5sum": ARRAY_MD5,
    "type": "std_msgs/Float64MultiArray",
}


def grasp(data):
    if not 0 <= data <= 100:
        raise CommandError("range", f"is {data}")
    return {"closure": np.array([data / 100.0])}


# What the bridge under test takes and gives.
COMMANDS = [
    CommandTopic("/grasp", "std_msgs/msg/Int32", grasp),
    CommandTopic("/startgrasp", "std_msgs/msg/Bool", lambda d: {"hold": [not d]}),
    CommandTopic("/kuka", "std_msgs/msg/Float64MultiArray", lambda d: {"arm": d}),
]
IMAGE = ros_topics.Topic(
    "/image",
    "sensor_msgs/msg/Image",
    {},
    lambda make, t, pixels: ros_topics.image_message(make, t, "top", "rgb8", pixels),
)
CLOCK, JOINTS = ros_topics.clock(), ros_topics.joint_states({"arm": ["a1", "a2"]})
TOPICS = [CLOCK, JOINTS, IMAGE]


def int32(value):
    """A std_msgs/Int32, framed."""
    return struct.pack("<Ii", 4, value)


def array(*values):
    """A std_msgs/Float64MultiArray, framed."""
    content = struct.pack(f"<III{len(values)}d", 0, 0, len(values), *values)
    return struct.pack("<I", len(content)) + content


def wait_until(condition, timeout=5.0):
    """Wait until `condition()` is true; return what it last was."""
    end = time.monotonic() + timeout
    while not (value := condition()) and time.monotonic() < end:
        time.sleep(0.01)
    return value


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def taken(inbox, name):
    """Wait for a command; return its last value."""
    values = {}

    def arrived():
        values.update(inbox.take())
        return name in values

    assert wait_until(arrived), name
    return np.asarray(values[name]).tolist()


def header(**fields):
    """A connection's header, written without our code."""
    parts = [f"{name}={value}".encode() for name, value in fields.items()]
    body = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(body)) + body


def receive(connection, size):
    data = b""
    while len(data) < size:
        piece = connection.recv(size - len(data))
        if not piece:
            raise ConnectionError(f"closed after {data}")
        data += piece
    return data


def receive_frame(connection):
    (size,) = struct.unpack("<I", receive(connection, 4))
    return receive(connection, size)


def receive_header(connection):
    body, fields = receive_frame(connection), {}
    while body:
        (size,) = struct.unpack("<I", body[:4])
        name, _, value = body[4 : 4 + size].decode().partition("=")
        fields[name], body = value, body[4 + size :]
    return fields


class Api:
    """An XML-RPC server of methods, in a thread."""

    def __init__(self, port=0, **methods):
        self._server = SimpleXMLRPCServer(("127.0.0.1", port), logRequests=False)
        for name, method in methods.items():
            self._server.register_function(method, name)
        self.port = self._server.server_address[1]
        self.uri = f"http://127.0.0.1:{self.port}/"
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.02,), daemon=True
        )
        self._thread.start()

    def close(self):
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class Master(Api):
    """Remembers what is registered, and who publishes what is subscribed to."""

    def __init__(self, port=0):
        self.publishers = {}  # topic to URIs that subscribers are told
        self.registered = {}  # (role, topic) to (node, type, URI)
        super().__init__(
            port,
            registerPublisher=lambda *a: self._register("Publisher", *a),
            registerSubscriber=lambda *a: self._register("Subscriber", *a),
            unregisterPublisher=lambda *a: self._unregister("Publisher", *a),
            unregisterSubscriber=lambda *a: self._unregister("Subscriber", *a),
            lookupNode=self._lookup,
        )

    def _register(self, role, node, topic, type, uri):
        self.registered[role, topic] = (node, type, uri)
        peers = self.publishers.get(topic, []) if role == "Subscriber" else []
        return [1, "", list(peers)]

    def _unregister(self, role, node, topic, uri):
        return [1, "", int(self.registered.pop((role, topic), None) is not None)]

    def _lookup(self, node, name):
        for known, _, uri in self.registered.values():
            if known == name:
                return [1, "", uri]
        return [-1, "unknown node", ""]

    @property
    def node(self):
        """The slave API of whoever is registered."""
        ((_, _, uri), *_) = self.registered.values()
        return xmlrpc.client.ServerProxy(uri)

    def tell(self, topic, *publishers):
        """Tell the node who publishes."""
        self.publishers[topic] = list(publishers)
        return self.node.publisherUpdate("/master", topic, list(publishers))


class Publisher:
    """A node that publishes one topic; the test says what its sockets send."""

    def __init__(self):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(5.0)
        self._connections = []
        port = self._listener.getsockname()[1]
        self._api = Api(requestTopic=lambda *_: [1, "", ["TCPROS", "127.0.0.1", port]])
        self.uri = self._api.uri

    def accept(self, **answer):
        """The next connection; its header is read, and answered if one is given."""
        connection, _ = self._listener.accept()
        connection.settimeout(5.0)
        self._connections.append(connection)
        self.header = receive_header(connection)
        if answer:
            connection.sendall(header(**answer))
        return connection

    def close(self):
        self._api.close()
        for connection in [self._listener, *self._connections]:
            connection.close()


def subscribe(node, topic, **fields):
    """Connect to a node and send a header; return the socket and its answer."""
    code, status, protocol = node.requestTopic("/peer", topic, [["TCPROS"]])
    assert code == 1, status
    connection = socket.create_connection(tuple(protocol[1:]), timeout=5.0)
    connection.sendall(header(topic=topic, **{"callerid": "/peer", **fields}))
    return connection, receive_header(connection)
