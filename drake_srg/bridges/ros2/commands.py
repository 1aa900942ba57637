"""Takes in commands from DDS."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from operator import itemgetter
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import (
    GuardCondition,
    InstanceState,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy
from cyclonedds.sub import DataReader
from cyclonedds.util import duration
from rosbags.serde import SerdeError
from rosbags.typesys.store import Typestore

from drake_srg.bridges.commands import CommandInbox
from drake_srg.bridges.ros2.dds_types import type_name

_RELIABILITIES = {
    "reliable": Policy.Reliability.Reliable(max_blocking_time=0),
    "best effort": Policy.Reliability.BestEffort,
}
# Allowed of a message [bytes]: as of TCPROS frames. Commands are a thousandth of it.
COMMAND_LIMIT = 2**20
# What may wait to be taken, of each topic: 1 kHz for a tenth of a second, should this
# thread not get to run. Of more, the last are kept. (Whatever their size is, which
# nobody but the domain limits: hence no more.)
_DEPTH = 100
# Samples that are taken out at once, all of them in memory.
_BATCH = 10
# Writers that are remembered; of more, the oldest are asked for again.
_MAX_WRITERS = 1000
# For the thread's end, and between tries after a fault [s, real].
_PATIENCE, _RETRY = 2.0, 0.1
_ANY = SampleState.Any | ViewState.Any | InstanceState.Any

# Makes a reader of a topic with policies of one's choice.
MakeReader = Callable[..., "DataReader[Any]"]


class CommandReader:
    """Puts commands into an inbox, in a thread of its own, until it is closed.

    Args:
        participant: Where to read.
        inbox: Where commands go; its topics are subscribed to.
        store: Has the messages' definitions.
        make_reader: Called as `make_reader(topic, *policies)`.
    """

    def __init__(
        self,
        participant: DomainParticipant,
        inbox: CommandInbox,
        store: Typestore,
        make_reader: MakeReader,
    ):
        self._inbox, self._store = inbox, store
        # A reliable reader hears nobody who publishes as best effort; a best-effort one
        # hears all, but may miss something. Of each writer one of the two is heard.
        self._readers = [
            (name, kind, make_reader(name, policy, Policy.History.KeepLast(_DEPTH)))
            for name in inbox.topics
            for kind, policy in _RELIABILITIES.items()
        ]
        self._is_best_effort: dict[int, bool] = {}  # by publication handle
        self._closed = threading.Event()
        self._publications = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
        self._closing = GuardCondition(participant)
        self._waitset = WaitSet(participant)
        self._waitset.attach(self._closing)
        for reader in (self._publications, *(reader for _, _, reader in self._readers)):
            self._waitset.attach(ReadCondition(reader, _ANY))
        self._thread = threading.Thread(target=self._run, name="ros2", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._closed.set()
        self._closing.set(True)
        self._thread.join(_PATIENCE)

    def _run(self) -> None:
        while not self._closed.is_set():
            try:
                self._waitset.wait(duration(seconds=1))
                self._take()
                self._check_types()
            except Exception as error:  # nothing ends commands but close()
                if not self._closed.wait(_RETRY):
                    text = f"ROS 2: reading commands fails: {error!r}"
                    self._inbox.warnings.warn("ROS 2 fault", text)

    def _take(self) -> None:
        # While one reader is looked at, others get older messages: once more, then.
        samples = found = list(self._waiting())
        while found and len(samples) < _DEPTH:
            found = list(self._waiting())
            samples = samples + found
        # Of several topics that command the same, the last message counts.
        for _, name, cdr in sorted(samples, key=itemgetter(0)):
            self._receive(name, cdr)

    def _waiting(self) -> Iterator[tuple[int, str, bytes]]:
        """Time of sending [ns], topic and data of what waits in the readers."""
        for name, kind, reader in self._readers:
            for sample in reader.take(_BATCH):
                info = sample.sample_info
                if not info.valid_data or (
                    kind == "best effort" and not self._offers_best_effort(reader, info)
                ):
                    continue
                if len(sample.cdr) > COMMAND_LIMIT:
                    reason = f"has {len(sample.cdr)} bytes; allowed are {COMMAND_LIMIT}"
                    self._inbox.refuse(name, "size", reason)
                else:
                    yield info.source_timestamp, name, sample.cdr

    def _receive(self, topic: str, cdr: bytes) -> None:
        kind = self._inbox.topics[topic].type
        try:
            message: Any = self._store.deserialize_cdr(cdr, kind)
        except SerdeError:
            self._inbox.refuse(topic, "malformed", f"is no {kind}")
        else:
            self._inbox.receive(topic, message.data)

    def _offers_best_effort(self, reader: DataReader[Any], info: Any) -> bool:
        """Whether a sample's writer is one whom the reliable reader does not hear."""
        handle = info.publication_handle
        if handle not in self._is_best_effort:
            if len(self._is_best_effort) >= _MAX_WRITERS:
                del self._is_best_effort[next(iter(self._is_best_effort))]
            writer = reader.get_matched_publication_data(handle)
            # A writer that is gone already may have been such.
            self._is_best_effort[handle] = (
                writer is None
                or writer.qos[Policy.Reliability] == Policy.Reliability.BestEffort
            )
        return self._is_best_effort[handle]

    def _check_types(self) -> None:
        """Warn of those who publish a command as something else."""
        for writer in self._publications.take(10):
            if writer.topic_name is None:  # of a writer that has left
                continue
            topic = self._inbox.topics.get(writer.topic_name.removeprefix("rt"))
            if topic is not None and writer.type_name != type_name(topic.type):
                self._inbox.warnings.warn(
                    f"{topic.name} type",
                    f"{topic.name}: somebody publishes it as {writer.type_name}; it is "
                    f"{topic.type}",
                )
