from drake_srg.hardware.faults import FaultsConfig, FaultyLink
from drake_srg.hardware.link import Link


class Counter(Link):
    def __init__(self):
        self.count, self.sent = 0, []

    def take(self):
        self.count += 1
        return {"n": self.count}

    def send(self, commands):
        self.sent.append(commands["n"])

    def close(self):
        pass


def test_latency_delays_both_directions():
    counter = Counter()
    counter.lag = 0.05
    link = FaultyLink(counter, FaultsConfig(latency=0.02), 0.005)
    assert link.lag == 0.05 + 2 * 0.02
    taken = []
    for n in range(10):
        taken.append(link.take().get("n"))
        link.send({"n": n})
    assert taken == [None] * 4 + [1, 2, 3, 4, 5, 6]
    assert counter.sent == [0, 1, 2, 3, 4, 5]


def test_a_share_of_messages_gets_lost():
    counter = Counter()
    link = FaultyLink(counter, FaultsConfig(loss=0.2), 0.005)
    arrived = 0
    for n in range(1000):
        arrived += bool(link.take())
        link.send({"n": n})
    assert 750 < arrived < 850
    assert 750 < len(counter.sent) < 850
