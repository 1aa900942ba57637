import contextlib
import socket
import xmlrpc.client
from urllib.parse import urlsplit

import pytest

from robot.serve.ros1 import peers
from robot.serve.ros1.peers import CLOCK, INT32, int32, taken


def test_a_node_answers_questions_about_itself(bridge, inbox, master, publisher):
    master.tell("/grasp", publisher.uri)
    publisher.accept(**INT32).sendall(int32(1))
    taken(inbox, "closure")
    connection, _ = peers.subscribe(master.node, "/clock", md5sum="*")
    bridge.publish(CLOCK, 1.0, [])
    peers.receive_frame(connection)
    node = master.node
    assert node.getMasterUri("/x") == [1, "", master.uri]
    assert ["/kuka", "std_msgs/Float64MultiArray"] in node.getSubscriptions("/x")[2]
    assert ["/clock", "rosgraph_msgs/Clock"] in node.getPublications("/x")[2]
    assert node.paramUpdate("/x", "/use_sim_time", True)[0] == 1
    info = {topic: row for row in node.getBusInfo("/x")[2] for topic in [row[4]]}
    assert info["/clock"][1:4] == ["/peer", "o", "TCPROS"]
    assert info["/grasp"][1:4] == [publisher.uri, "i", "TCPROS"]
    assert node.requestTopic("/x", "/clock", [["UDPROS"]])[0] == 0
    assert node.requestTopic("/x", "/nothing", [["TCPROS"]])[0] == -1
    assert node.publisherUpdate("/x", "/nothing", [])[0] == -1


@pytest.mark.parametrize("method", ["noSuchMethod", "_shutdown", "answer", "getPid"])
def test_an_invalid_call_is_answered_with_a_fault(bridge, master, method):
    with pytest.raises(xmlrpc.client.Fault):
        getattr(master.node, method)()  # getPid lacks the caller's name


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
def test_garbage_instead_of_a_request_is_refused_with_one_warning(
    bridge, master, told, garbage
):
    uri = urlsplit(master.node_uri)
    for _ in range(2):
        with (
            contextlib.suppress(OSError),  # possibly closed before all is sent
            socket.create_connection((uri.hostname, uri.port), timeout=20.0) as peer,
        ):
            peer.sendall(garbage)
            peer.shutdown(socket.SHUT_WR)
            assert peer.recv(1) == b""
    assert len(told.about("refused a request")) == 1
    assert master.node.getPid("/x")[0] == 1
