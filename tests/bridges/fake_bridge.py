"""A bridge whose client is the test."""

from drake_srg.bridges.bridge import Bridge


class FakeBridge(Bridge):
    """Keeps what is published and told, (time, values) each, in lists.

    `act(bridge)` is called every control period, in the loop.
    """

    status = "fake"

    def __init__(self, *, wanted=lambda name: True, ports=(), act=lambda bridge: None):
        self.ports = ports
        self.messages = {}  # topic name to list of (time, values)
        self.updates = []  # (time, values)
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
