"""Receive commands over DDS."""

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

from drake_srg.bridges.commands import COMMAND_LIMIT, CommandInbox, CommandTopic
from drake_srg.bridges.ros2.dds_types import type_name

# Reliable first: its samples show which writers need no best-effort reader.
_RELIABILITIES = {
    "reliable": Policy.Reliability.Reliable(max_blocking_time=0),
    "best effort": Policy.Reliability.BestEffort,
}
# Samples that may wait per topic, in case this thread does not get to run: 0.1 s at
# 1 kHz. Beyond that the oldest are lost. Not more, because only the domain's limit
# bounds their size.
QUEUE_DEPTH = 100
# The same for topics of larger messages, pictures, of which only the newest counts.
_PICTURES_DEPTH = 2
# Samples taken at once, all of which are then in memory.
_BATCH = 10
# Writers whose reliability is remembered. Beyond that, the oldest are looked up again.
_MAX_WRITERS = 1000
# How long to wait for the thread's end, and before the next attempt after a fault
# [s, real].
_PATIENCE, _RETRY = 2.0, 0.1
_ANY = SampleState.Any | ViewState.Any | InstanceState.Any

# Returns a reader of a topic with the given policies.
MakeReader = Callable[..., "DataReader[Any]"]


class CommandReader:
    """Receives commands in a thread of its own until it is closed.

    Args:
        participant: The DDS participant that reads.
        inbox: Where commands go; its topics are subscribed to.
        store: Has the messages' definitions.
        make_reader: Returns a reader; called as `make_reader(topic, *policies)`.
    """

    def __init__(
        self,
        participant: DomainParticipant,
        inbox: CommandInbox,
        store: Typestore,
        make_reader: MakeReader,
    ):
        self._inbox, self._store = inbox, store
        # A reliable reader does not match best-effort writers. A best-effort reader
        # matches all writers but may miss samples. So each topic has both, and each
        # writer counts at one of them.
        self._readers = [
            (
                name,
                mode,
                make_reader(name, policy, Policy.History.KeepLast(_depth(topic))),
            )
            for name, topic in inbox.topics.items()
            for mode, policy in _RELIABILITIES.items()
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
            except Exception as error:  # only close() may end this loop
                if not self._closed.wait(_RETRY):
                    text = f"ROS 2: cannot read commands: {error!r}"
                    self._inbox.warnings.warn("ROS 2 fault", text)

    def _take(self) -> None:
        # While one reader is read, older messages may reach another: read again.
        samples = found = list(self._waiting())
        while found and len(samples) < QUEUE_DEPTH:
            found = list(self._waiting())
            samples = samples + found
        # Where several topics command the same port, the last message wins.
        for _, name, cdr in sorted(samples, key=itemgetter(0)):
            self._receive(name, cdr)

    def _waiting(self) -> Iterator[tuple[int, str, bytes]]:
        """Yield source time [ns], topic and data of each sample in the readers."""
        for name, mode, reader in self._readers:
            for sample in reader.take(_BATCH):
                info = sample.sample_info
                if not info.valid_data:
                    continue
                if mode == "reliable":
                    self._remember(info.publication_handle, best_effort=False)
                elif not self._offers_best_effort(reader, info.publication_handle):
                    continue
                largest = self._inbox.topics[name].largest
                if len(sample.cdr) > largest:
                    reason = f"must have at most {largest} bytes, got "
                    self._inbox.refuse(name, "size", f"{reason}{len(sample.cdr)}")
                else:
                    yield info.source_timestamp, name, sample.cdr

    def _receive(self, topic: str, cdr: bytes) -> None:
        type = self._inbox.topics[topic].type
        try:
            message: Any = self._store.deserialize_cdr(cdr, type)
        except SerdeError:
            self._inbox.refuse(topic, "malformed", f"must be a {type}")
        else:
            self._inbox.receive_message(topic, message)

    def _offers_best_effort(self, reader: DataReader[Any], handle: int) -> bool:
        """Return whether a writer does not match the reliable reader."""
        if handle not in self._is_best_effort:
            writer = reader.get_matched_publication_data(handle)
            # A writer that has left without a reliable sample may have been such.
            self._remember(
                handle,
                best_effort=writer is None
                or writer.qos[Policy.Reliability] == Policy.Reliability.BestEffort,
            )
        return self._is_best_effort[handle]

    def _remember(self, handle: int, *, best_effort: bool) -> None:
        """Remember a writer's reliability by its publication handle."""
        if handle not in self._is_best_effort:
            while len(self._is_best_effort) >= _MAX_WRITERS:
                del self._is_best_effort[next(iter(self._is_best_effort))]
        self._is_best_effort[handle] = best_effort

    def _check_types(self) -> None:
        """Warn of writers that publish a command with another type."""
        for writer in self._publications.take(10):
            if writer.topic_name is None:  # the writer has left
                continue
            topic = self._inbox.topics.get(writer.topic_name.removeprefix("rt"))
            if topic is not None and writer.type_name != type_name(topic.type):
                self._inbox.warnings.warn(
                    f"{topic.name} type",
                    f"{topic.name}: must be {topic.type}, but a node publishes it as "
                    f"{writer.type_name}",
                )


def _depth(topic: CommandTopic) -> int:
    return QUEUE_DEPTH if topic.largest <= COMMAND_LIMIT else _PICTURES_DEPTH
