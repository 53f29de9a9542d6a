"""Runs at the same time get different domains; the user's choice stands."""

from __future__ import annotations

import pytest

from omni_bringup.ros_domain import reserved_domain


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


def test_the_users_domain_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    with reserved_domain() as domain:
        assert domain == 42
