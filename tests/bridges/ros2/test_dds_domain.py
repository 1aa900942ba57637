import re

import pytest

from bridges.ros2.peers import free_domain
from drake_srg.bridges.ros2.dds_domain import domain_id, open_participant


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)


@pytest.mark.parametrize("domain", [0, 1, 232])
def test_a_domain_may_be_0_to_232(domain):
    assert domain_id(domain) == domain


@pytest.mark.parametrize("domain", [-1, 233, 1000])
def test_other_domains_are_refused(domain):
    with pytest.raises(
        ValueError, match=f"ROS 2 domain: must be 0 to 232, got {domain}"
    ):
        domain_id(domain)


@pytest.mark.parametrize("text, domain", [("", 0), ("0", 0), ("42", 42)])
def test_the_environment_has_the_default_domain(monkeypatch, text, domain):
    assert domain_id(None) == 0
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    assert domain_id(None) == domain
    assert domain_id(7) == 7


@pytest.mark.parametrize("text", ["300", "-1", "one", "1.5", "²"])
def test_an_invalid_domain_in_the_environment_is_refused(monkeypatch, text):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    message = f"ROS_DOMAIN_ID: must be 0 to 232, got {text}"
    with pytest.raises(ValueError, match=message):
        domain_id(None)


@pytest.mark.parametrize("interface", ["127.0.0.1", "lo"])
@pytest.mark.parametrize("domain", [None, 232])
def test_a_domain_can_be_opened_and_closed_repeatedly(interface, domain):
    domain = free_domain() if domain is None else domain
    for _ in range(3):
        with open_participant(domain, interface, "test", 2**20) as participant:
            assert participant.get_domain_id() == domain


@pytest.mark.parametrize("interface", ["198.51.100.1", "::1", "0.0.0.0", ""])
def test_an_invalid_interface_is_refused(interface):
    message = f"host: must be an IPv4 address .*, got '{re.escape(interface)}'"
    with (
        pytest.raises(ValueError, match=message),
        open_participant(free_domain(), interface, "test", 2**20),
    ):
        pass


def test_a_cyclonedds_uri_replaces_the_interface(monkeypatch, capfd):
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Nonsense/></CycloneDDS>")
    domain = free_domain()
    with (
        pytest.raises(OSError, match=f"cannot open domain {domain}"),
        open_participant(domain, "127.0.0.1", "test", 2**20),
    ):
        pass
    assert "Nonsense" in capfd.readouterr().err
    interface = '<Interfaces><NetworkInterface name="lo"/></Interfaces>'
    monkeypatch.setenv("CYCLONEDDS_URI", f"<General>{interface}</General>")
    with open_participant(domain, "nothing", "test", 2**20):
        pass
