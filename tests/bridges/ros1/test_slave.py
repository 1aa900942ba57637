import contextlib
import socket
import xmlrpc.client

import pytest

from bridges.ros1 import ros1_peers as peers
from bridges.ros1.ros1_peers import (
    CLOCK,
    INT32,
    int32,
    taken,
)


def test_what_is_asked_about_the_node(ros1_bridge, inbox, ros1_master, ros1_publisher):
    ros1_master.tell("/grasp", ros1_publisher.uri)
    ros1_publisher.accept(**INT32).sendall(int32(1))
    taken(inbox, "closure")
    connection, _ = peers.subscribe(ros1_master.node, "/clock", md5sum="*")
    ros1_bridge.publish(CLOCK, 1.0, [])
    peers.receive_frame(connection)
    node = ros1_master.node
    assert node.getMasterUri("/x") == [1, "", ros1_master.uri]
    assert ["/kuka", "std_msgs/Float64MultiArray"] in node.getSubscriptions("/x")[2]
    assert ["/clock", "rosgraph_msgs/Clock"] in node.getPublications("/x")[2]
    assert node.paramUpdate("/x", "/use_sim_time", True)[0] == 1
    info = {topic: row for row in node.getBusInfo("/x")[2] for topic in [row[4]]}
    assert info["/clock"][1:4] == ["/peer", "o", "TCPROS"]
    assert info["/grasp"][1:4] == [ros1_publisher.uri, "i", "TCPROS"]
    sent, received, services = node.getBusStats("/x")[2]
    assert ["/clock", 12, [[info["/clock"][0], 12, 1, True]]] in sent
    assert ["/grasp", [[info["/grasp"][0], 4, -1, True]]] in received
    assert services == []
    assert node.requestTopic("/x", "/clock", [["UDPROS"]])[0] == 0
    assert node.requestTopic("/x", "/nothing", [["TCPROS"]])[0] == -1
    assert node.publisherUpdate("/x", "/nothing", [])[0] == -1


@pytest.mark.parametrize("method", ["noSuchMethod", "_shutdown", "answer", "getPid"])
def test_calls_that_cannot_be_answered(ros1_bridge, ros1_master, method):
    with pytest.raises(xmlrpc.client.Fault):
        getattr(ros1_master.node, method)()  # getPid lacks the caller


@pytest.mark.parametrize(
    "garbage",
    [
        b"\0" * 100 + b"\r\n\r\n",
        b"POST / HTTP/1.0\r\nContent-Length: 999999999\r\n\r\n",
        b"POST / HTTP/1.0\r\nContent-Length: 3\r\n\r\n<<<",
        b"x" * 200_000,
        b"POST / HTTP/1.0\r\nContent-Le",
    ],
)
def test_requests_that_are_none(ros1_bridge, ros1_master, told, garbage):
    host, port = ros1_bridge._node.uri[7:-1].split(":")
    for _ in range(2):
        with (
            contextlib.suppress(OSError),  # closed before all is sent, maybe
            socket.create_connection((host, int(port)), timeout=5.0) as connection,
        ):
            connection.sendall(garbage)
            connection.shutdown(socket.SHUT_WR)
            assert connection.recv(1) == b""
    assert len(told.about("a request is refused")) == 1
    assert ros1_master.node.getPid("/x")[0] == 1
