"""DDS domains as ROS 2 numbers them, on an interface of one's choice."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.qos import Policy, Qos

from drake_srg.bridges.addresses import own_address

# From 233 on, the UDP ports that DDSI's formula gives a domain are above 65535.
_MAX_DOMAIN = 232
# Not every loopback interface has multicast to find others by. So they are looked for,
# too, at the ports of as many as ROS 2 expects where it stays on its machine.
_CONFIGURATION = """
<CycloneDDS><Domain>
  <General><Interfaces><NetworkInterface address="{address}"/></Interfaces></General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
    <Peers AddLocalhost="true"/>
  </Discovery>
  <Internal><MaxSampleSize>{max_size} B</MaxSampleSize></Internal>
</Domain></CycloneDDS>
"""


def domain_id(domain: int | None) -> int:
    """Return a domain's number, the environment's ROS_DOMAIN_ID or 0 for None.

    Raises:
        ValueError: If it is none.
    """
    text = os.environ.get("ROS_DOMAIN_ID") or "0" if domain is None else str(domain)
    if not text.isascii() or not text.isdigit() or int(text) > _MAX_DOMAIN:
        origin = "ROS_DOMAIN_ID" if domain is None else "the ROS 2 domain"
        raise ValueError(f"{origin} is {text}; allowed are 0 to {_MAX_DOMAIN}")
    return int(text)


@contextmanager
def open_participant(
    domain: int, interface: str, name: str, max_size: int
) -> Iterator[DomainParticipant]:
    """Open a DDS domain and take part in it; close all that was made in it at the end.

    Where the environment has a CYCLONEDDS_URI, that decides instead of `interface` and
    `max_size`. Otherwise Cyclone DDS tells others of the interface's address alone and
    sends there alone; but its sockets take in what arrives for their ports at any
    interface, which no setting changes.

    Args:
        domain: Its number.
        interface: IPv4 address or name of the network interface to use.
        name: Of the participant.
        max_size: Of a sample that is sent or received [bytes]. What is larger is
            dropped, and Cyclone DDS writes a line on it to stderr.

    Raises:
        ValueError: If this machine has no such interface, or the domain is open in this
            process.
        OSError: If Cyclone DDS does not open it; it has written to stderr why.
    """
    configuration = os.environ.get("CYCLONEDDS_URI") or _CONFIGURATION.format(
        address=own_address(interface), max_size=max_size
    )
    try:
        entity = Domain(domain, configuration)
    except DDSException as error:
        if error.code == DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
            raise ValueError(
                f"the ROS 2 domain {domain} is open already in this process"
            ) from error
        raise OSError(f"Cyclone DDS does not open domain {domain}: {error}") from error
    try:
        # User data as rmw's: the enclave of SROS.
        qos = Qos(Policy.EntityName(name), Policy.Userdata(b"enclave=/;"))
        yield DomainParticipant(domain, qos)
    finally:
        entity.__del__()  # deletes what is in it, whoever still refers to that
