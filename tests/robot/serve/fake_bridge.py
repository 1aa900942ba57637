"""A bridge whose client is the test."""

from drake_srg.robot.serve.bridge import Bridge


class FakeBridge(Bridge):
    """Keeps published messages and updates; calls `act(bridge)` every control period.

    Attributes:
        messages: List of (time, values) by topic name.
        updates: List of (time, values).
        time: Time of the last update [s].
        is_closed: Whether the station has closed it.
    """

    status = "fake"

    def __init__(self, *, wanted=lambda name: True, ports=(), act=lambda bridge: None):
        self.ports = ports
        self.messages = {}
        self.updates = []
        self.is_closed = False
        self.time = 0.0
        self._wanted, self._act = wanted, act

    def connect(self, inbox, topics):
        self.inbox, self.topics = inbox, topics
        return [self]

    def has_subscribers(self, topic):
        return self._wanted(topic)

    def publish(self, topic, time, values):
        self.messages.setdefault(topic.name, []).append((time, values))

    def update(self, time, values):
        self.updates.append((time, values))
        self.time = time
        self._act(self)

    def close(self):
        self.is_closed = True
