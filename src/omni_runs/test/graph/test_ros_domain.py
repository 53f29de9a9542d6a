"""Simultaneous runs get different domains; a domain chosen by the user is kept."""

from __future__ import annotations

import contextlib
import socket

import pytest

from omni_core.configuration import ConfigurationError
from omni_ros.environment import node_environment
from omni_runs.graph.domain import NoFreeDomainError, reserved_domain


def test_two_runs_get_different_domains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with reserved_domain() as first, reserved_domain() as second:
        assert first != second
        assert min(first, second) >= 1
        assert max(first, second) <= 101


def test_a_domain_is_free_again_after_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with reserved_domain() as first:
        pass
    with reserved_domain() as again:
        assert again == first


def test_a_domain_with_another_ros_program_is_left_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with reserved_domain() as first:
        pass
    # The two ports of a participant, by the rule of RTPS.
    with contextlib.ExitStack() as stack:
        for port in (7400 + 250 * first + offset for offset in (12, 13)):
            listener = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            listener.bind(("", port))
        with reserved_domain() as other:
            assert other != first
        # In a domain chosen by the user, other programs may listen.
        monkeypatch.setenv("ROS_DOMAIN_ID", str(first))
        with reserved_domain() as chosen:
            assert chosen == first


def test_the_users_domain_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    with reserved_domain() as domain:
        assert domain == 42


def test_a_chosen_domain_is_for_one_run_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "91")
    with (
        reserved_domain(),
        pytest.raises(NoFreeDomainError, match=r"^ROS domain 91 is in use by another run"),
        reserved_domain(),
    ):
        pass
    with reserved_domain() as again:
        assert again == 91


def test_a_chosen_domain_is_not_given_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with reserved_domain() as first:
        pass
    monkeypatch.setenv("ROS_DOMAIN_ID", str(first))
    with reserved_domain():
        monkeypatch.delenv("ROS_DOMAIN_ID")
        with reserved_domain() as other:
            assert other != first


@pytest.mark.parametrize("text", ["abc", "999", "233", "-1", "1.5", " 5", "010", "٣"])
def test_what_is_no_domain_is_refused(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with (
        pytest.raises(ConfigurationError, match=r"^ROS_DOMAIN_ID: .* from 0 to 232"),
        reserved_domain(),
    ):
        pass


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ROS_STATIC_PEERS", "127.0.0.1;no host"),
        ("ROS_LOG_DIR", "/proc/x"),
        ("ROS_HOME", "/dev/null"),
    ],
)
def test_a_variable_with_which_no_node_starts_is_named(
    name: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_LOG_DIR", raising=False)
    monkeypatch.setenv(name, value)
    problem = r": (no host is named 'no host'|cannot write logs to /).*; "
    with pytest.raises(ConfigurationError, match=f"^{name}{problem}"), reserved_domain():
        pass


def test_nodes_that_could_not_find_each_other_are_not_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    with (
        pytest.raises(ConfigurationError, match=r"^ROS_AUTOMATIC_DISCOVERY_RANGE: .*LOCALHOST"),
        reserved_domain(),
    ):
        pass


def test_an_empty_choice_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    with reserved_domain() as domain:
        assert domain >= 1
        assert node_environment(domain)["ROS_DOMAIN_ID"] == str(domain)
