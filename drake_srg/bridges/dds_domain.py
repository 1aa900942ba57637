"""DDS domains as ROS 2 numbers them, on an interface of one's choice."""

from __future__ import annotations

import ipaddress
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from xml.sax.saxutils import quoteattr

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.qos import Policy, Qos

# From 233 on, the UDP ports that DDSI's formula gives a domain are above 65535.
_MAX_DOMAIN = 232
# Not every loopback interface has multicast to find others by. So they are looked for,
# too, at the ports of as many as ROS 2 expects where it stays on its machine.
_CONFIGURATION = """
<CycloneDDS><Domain>
  <General><Interfaces><NetworkInterface {interface}/></Interfaces></General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
    <Peers AddLocalhost="true"/>
  </Discovery>
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
    domain: int, interface: str, name: str
) -> Iterator[DomainParticipant]:
    """Open a DDS domain and take part in it; close all that was made in it at the end.

    Args:
        domain: Its number.
        interface: Address or name of the network interface to use; ignored where the
            environment has a CYCLONEDDS_URI.
        name: Of the participant.

    Raises:
        ValueError: If this machine has no such interface, or the domain is open in this
            process.
        OSError: If Cyclone DDS does not open it; it has written to stderr why.
    """
    configuration = os.environ.get("CYCLONEDDS_URI") or _CONFIGURATION.format(
        interface=_interface(interface)
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


def _interface(interface: str) -> str:
    """Cyclone DDS's attribute that names an interface, checked."""
    try:
        address = ipaddress.ip_address(interface)
    except ValueError:
        attribute = "name"
    else:
        attribute = "address"
    try:
        if attribute == "name":
            socket.if_nametoindex(interface)
        else:
            family = socket.AF_INET if address.version == 4 else socket.AF_INET6
            with socket.socket(family, socket.SOCK_DGRAM) as probe:
                probe.bind((interface, 0))
    except OSError as error:
        names = [name for _, name in socket.if_nameindex()]
        raise ValueError(
            f"no network interface {interface!r}; allowed are this machine's addresses "
            f"and {', '.join(names)}"
        ) from error
    return f"{attribute}={quoteattr(interface)}"
