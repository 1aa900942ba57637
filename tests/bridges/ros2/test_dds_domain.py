import re

import pytest

from bridges.ros2.ros2_peers import free_domain
from drake_srg.bridges.ros2.dds_domain import domain_id, open_participant


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)


@pytest.mark.parametrize("domain", [0, 1, 232])
def test_domains_are_0_to_232(domain):
    assert domain_id(domain) == domain


@pytest.mark.parametrize("domain", [-1, 233, 1000])
def test_others_are_none(domain):
    with pytest.raises(ValueError, match=f"{domain}; allowed are 0 to 232"):
        domain_id(domain)


@pytest.mark.parametrize("text, domain", [("", 0), ("0", 0), ("42", 42)])
def test_the_environment_has_the_default(monkeypatch, text, domain):
    assert domain_id(None) == 0
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    assert domain_id(None) == domain
    assert domain_id(7) == 7


@pytest.mark.parametrize("text", ["300", "-1", "one", "1.5", "²"])
def test_the_environment_may_be_wrong(monkeypatch, text):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(ValueError, match=f"ROS_DOMAIN_ID is {text}; allowed are 0 to"):
        domain_id(None)


@pytest.mark.parametrize("interface", ["127.0.0.1", "lo"])
@pytest.mark.parametrize("domain", [None, 232])
def test_a_domain_opens_and_closes_again_and_again(interface, domain):
    domain = free_domain() if domain is None else domain
    for _ in range(3):
        with open_participant(domain, interface, "test", 2**20) as participant:
            assert participant.get_domain_id() == domain


@pytest.mark.parametrize("interface", ["198.51.100.1", "::1", "0.0.0.0", ""])
def test_an_interface_that_is_none_is_refused(interface):
    message = f"host is '{re.escape(interface)}'; allowed is one IPv4 address"
    with (
        pytest.raises(ValueError, match=message),
        open_participant(free_domain(), interface, "test", 2**20),
    ):
        pass


def test_a_cyclonedds_uri_decides_alone(monkeypatch, capfd):
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Nonsense/></CycloneDDS>")
    domain = free_domain()
    with (
        pytest.raises(OSError, match=f"does not open domain {domain}"),
        open_participant(domain, "127.0.0.1", "test", 2**20),
    ):
        pass
    assert "Nonsense" in capfd.readouterr().err
    interface = '<Interfaces><NetworkInterface name="lo"/></Interfaces>'
    monkeypatch.setenv("CYCLONEDDS_URI", f"<General>{interface}</General>")
    with open_participant(domain, "nothing", "test", 2**20):
        pass
