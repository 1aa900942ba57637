from drake_srg.bridges.bridge import Bridge
from drake_srg.recording import ros_topics


def test_a_plain_bridge_has_no_clients_and_does_nothing():
    bridge, clock = Bridge(), ros_topics.clock()
    assert bridge.status == ""
    assert not bridge.ports
    assert not bridge.closed
    assert not bridge.has_subscribers(clock.name)
    bridge.publish(clock, 0.0, [])
    bridge.update(0.0, {})
    bridge.close()
    bridge.close()
