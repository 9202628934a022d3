from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from socialbot.bridge import environment
from socialbot.bridge.environment import Across, prepare
from socialbot.bridge.ros_checks import segment_size
from socialbot.core.errors import GraphError

PROFILE, DATAGRAM = environment.PROFILE_VARIABLE, environment.DATAGRAM_VARIABLE


def prepared(variables: dict[str, str] | None = None, **options) -> dict[str, str]:
    found = dict(variables or {})
    prepare(found, **options)
    return found


def test_by_default_nodes_talk_to_this_machine_only() -> None:
    found = prepared()
    assert found[PROFILE] == str(environment.PROFILE)
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert "ROS_STATIC_PEERS" not in found


def test_what_is_set_stays_and_what_is_given_overrides(tmp_path: Path) -> None:
    found = prepared(
        {"ROS_DOMAIN_ID": "3", PROFILE: "my.xml", "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, domain=5, log_folder=tmp_path
    )
    assert (found["ROS_DOMAIN_ID"], found["ROS_LOG_DIR"]) == ("5", str(tmp_path))
    assert (found[PROFILE], found["ROS_AUTOMATIC_DISCOVERY_RANGE"]) == ("my.xml", "OFF")


def test_readers_of_some_topics_take_udp_only(tmp_path: Path) -> None:
    found = prepared()
    environment.read_by_udp(["/speech/say", "/health", "/health"], tmp_path / "log" / "dds.xml", found)
    assert found[PROFILE] == str(tmp_path / "log" / "dds.xml")
    profile = ElementTree.parse(found[PROFILE])
    names = [one.get("profile_name") for one in profile.iter() if one.tag.endswith("data_reader")]
    assert names == ["/health", "/speech/say"]
    kept = [one.tag for one in ElementTree.parse(environment.PROFILE).iter()]
    assert [one.tag for one in profile.iter()][: len(kept)] == kept, "all else is as it was"
    prepare(found)
    assert found[PROFILE] == str(tmp_path / "log" / "dds.xml"), "what comes later leaves it alone"


def test_a_profile_of_the_users_own_and_that_for_networks_are_left_alone(tmp_path: Path) -> None:
    own = prepared({PROFILE: "my.xml"})
    open_ = prepared({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"})
    for found in (own, open_):
        before = dict(found)
        environment.read_by_udp(["/health"], tmp_path / "dds.xml", found)
        assert found == before
    assert not list(tmp_path.iterdir())


def test_across_machines_by_addresses() -> None:
    # The launcher itself was prepared for one machine, and hands its variables on.
    found = prepared(prepared(), across=Across(peers=("10.77.0.1", "10.77.0.3")))
    assert found[PROFILE] == str(environment.WIFI_PROFILE)
    assert found["ROS_STATIC_PEERS"] == "10.77.0.1;10.77.0.3"
    assert found["ROS_DISCOVERY_SERVER"] == ""
    assert int(found[DATAGRAM]) + 28 <= 1500
    assert prepared(found) == found


def test_across_machines_by_a_discovery_server() -> None:
    found = prepared(across=Across(server="10.77.0.1:11811"))
    assert (found["ROS_DISCOVERY_SERVER"], found["ROS_STATIC_PEERS"]) == ("10.77.0.1:11811", "")


@pytest.mark.parametrize(
    "opened",
    [
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"},
        {"ROS_STATIC_PEERS": "10.77.0.2"},
        {"ROS_DISCOVERY_SERVER": "10.77.0.1:11811"},
    ],
)
def test_only_a_graph_that_the_user_opens_listens_to_others(opened: dict[str, str]) -> None:
    found = prepared(opened)
    assert found[PROFILE] == str(environment.WIFI_PROFILE)
    assert int(found[DATAGRAM]) > 16 * 2**20
    assert prepared(found) == found
    closed = prepared({**found, "ROS_AUTOMATIC_DISCOVERY_RANGE": "", **dict.fromkeys(opened, "")})
    assert closed[PROFILE] == str(environment.PROFILE)
    addresses = [one.text for one in ElementTree.parse(environment.PROFILE).iter() if one.tag.endswith("}address")]
    assert set(addresses) == {"127.0.0.1"}


def test_raw_pictures_are_not_cut_up_on_their_own_machine() -> None:
    found = prepared(across=Across(peers=("10.77.0.2",)), raw_pictures=True)
    assert int(found[DATAGRAM]) > 16 * 2**20
    assert prepared(found, across=Across(peers=("10.77.0.2",)))[DATAGRAM] == str(environment.PACKET_BYTES)


def test_a_profile_of_the_users_own_is_left_alone() -> None:
    assert prepared({PROFILE: "my.xml"}, across=Across(peers=("a",)))[PROFILE] == "my.xml"


def test_both_profiles_have_the_same_shared_memory() -> None:
    assert segment_size(environment.PROFILE) == segment_size(environment.WIFI_PROFILE) == 32 * 2**20
    texts = [one.text or "" for one in ElementTree.parse(environment.WIFI_PROFILE).iter()]
    assert f"${{{DATAGRAM}}}" in texts


@pytest.mark.parametrize("domain", ["-1", "233", "x", "1.5"])
def test_domains_that_are_none(domain: str) -> None:
    with pytest.raises(GraphError, match="not a ROS domain"):
        environment.check_domain({"ROS_DOMAIN_ID": domain})
