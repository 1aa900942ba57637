"""DDS domains with ROS 2's numbers, on a chosen network interface."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.qos import Policy, Qos

from drake_srg.bridges.addresses import own_address

# From 233 on, DDSI's formula gives a domain UDP ports above 65535.
_MAX_DOMAIN = 232
# Not every loopback interface supports multicast discovery. Therefore peers are also
# sought by unicast, at the ports of as many participants as ROS 2 allows on localhost.
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
    """Return a domain's number; None takes ROS_DOMAIN_ID, or 0 if it is not set.

    Raises:
        ValueError: If the number is invalid.
    """
    text = os.environ.get("ROS_DOMAIN_ID") or "0" if domain is None else str(domain)
    if not text.isascii() or not text.isdigit() or int(text) > _MAX_DOMAIN:
        origin = "ROS_DOMAIN_ID" if domain is None else "ROS 2 domain"
        raise ValueError(f"{origin}: must be 0 to {_MAX_DOMAIN}, got {text}")
    return int(text)


@contextmanager
def open_participant(
    domain: int, interface: str, name: str, max_size: int
) -> Iterator[DomainParticipant]:
    """Open a DDS domain and join it; on exit, delete everything created in it.

    If the environment has a CYCLONEDDS_URI, that replaces `interface` and `max_size`.
    Otherwise Cyclone DDS announces only the interface's address and sends only there.
    Its sockets nevertheless receive at every interface, which no setting changes.

    Args:
        domain: The domain's number.
        interface: IPv4 address or name of the network interface to use.
        name: The participant's name.
        max_size: Largest sample to send or receive [bytes]. Cyclone DDS drops larger
            ones and writes a line to stderr.

    Raises:
        ValueError: If this machine has no such interface, or the domain is already open
            in this process.
        OSError: If Cyclone DDS cannot open the domain; it writes the reason to stderr.
    """
    configuration = os.environ.get("CYCLONEDDS_URI") or _CONFIGURATION.format(
        address=own_address(interface), max_size=max_size
    )
    try:
        entity = Domain(domain, configuration)
    except DDSException as error:
        if error.code == DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
            raise ValueError(
                f"ROS 2 domain {domain} is already open in this process"
            ) from error
        raise OSError(f"Cyclone DDS cannot open domain {domain}: {error}") from error
    try:
        # The user data that ROS 2's middleware sets: the enclave of SROS.
        qos = Qos(Policy.EntityName(name), Policy.Userdata(b"enclave=/;"))
        yield DomainParticipant(domain, qos)
    finally:
        entity.__del__()  # deletes its contents even if something still refers to them
