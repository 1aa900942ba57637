"""Peers of a ROS 1 node, made of plain sockets and the standard library."""

import socket
import struct
import threading
import xmlrpc.client
from xmlrpc.server import SimpleXMLRPCServer

import numpy as np

from drake_srg.recording import rosbag
from drake_srg.robot.serve.commands import CommandError, CommandTopic
from robot.serve.waiting import wait_until

# From `rosmsg md5`.
INT32_MD5 = "da5909fbe378aeaf85e547e830cc1bb7"
ARRAY_MD5 = "4b7d974086d4060e7db4613a7e6c3ba4"
CLOCK_MD5 = "a9c97c1d230cfc112e270351a944ee47"

# Connection headers of publishers.
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


# The topics of the bridge under test.
COMMANDS = [
    CommandTopic("/grasp", "std_msgs/msg/Int32", grasp),
    CommandTopic("/startgrasp", "std_msgs/msg/Bool", lambda d: {"hold": [not d]}),
    CommandTopic("/kuka", "std_msgs/msg/Float64MultiArray", lambda d: {"arm": d}),
]
IMAGE = rosbag.Topic(
    "/image",
    "sensor_msgs/msg/Image",
    {},
    lambda make, t, pixels: rosbag.image_message(make, t, "top", "rgb8", pixels),
)
CLOCK, JOINTS = rosbag.clock(), rosbag.joint_states({"arm": ["a1", "a2"]})
TOPICS = [CLOCK, JOINTS, IMAGE]


def int32(value):
    """Return a framed std_msgs/Int32."""
    return struct.pack("<Ii", 4, value)


def array(*values):
    """Return a framed std_msgs/Float64MultiArray."""
    content = struct.pack(f"<III{len(values)}d", 0, 0, len(values), *values)
    return struct.pack("<I", len(content)) + content


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def taken(inbox, name):
    """Wait for a command and return its last value."""
    values = {}

    def arrived():
        values.update(inbox.take())
        return name in values

    assert wait_until(arrived), name
    return np.asarray(values[name]).tolist()


def header(**fields):
    """Return a framed connection header, encoded independently of the package."""
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
    """An XML-RPC server in a thread."""

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
    """A master that keeps registrations and lists of publishers."""

    def __init__(self, port=0):
        self.publishers = {}  # topic to the publishers' URIs, given to subscribers
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
    def node_uri(self):
        """URI of the registered node."""
        ((_, _, uri), *_) = self.registered.values()
        return uri

    @property
    def node(self):
        """The slave API of the registered node."""
        return xmlrpc.client.ServerProxy(self.node_uri)

    def tell(self, topic, *publishers):
        """Send the node a list of publishers' URIs."""
        self.publishers[topic] = list(publishers)
        return self.node.publisherUpdate("/master", topic, list(publishers))


class Publisher:
    """A node that publishes one topic; the test writes to its sockets."""

    def __init__(self):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(20.0)
        self._connections = []
        port = self._listener.getsockname()[1]
        self._api = Api(requestTopic=lambda *_: [1, "", ["TCPROS", "127.0.0.1", port]])
        self.uri = self._api.uri

    def accept(self, **answer):
        """Return the next connection; read its header, and answer with fields."""
        connection, _ = self._listener.accept()
        connection.settimeout(20.0)
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
    connection = socket.create_connection(tcpros_address(node, topic), timeout=20.0)
    connection.sendall(header(topic=topic, **{"callerid": "/peer", **fields}))
    return connection, receive_header(connection)


def tcpros_address(node, topic):
    """Return the host and port at which a node publishes a topic."""
    code, status, protocol = node.requestTopic("/peer", topic, [["TCPROS"]])
    assert code == 1, status
    return tuple(protocol[1:])
