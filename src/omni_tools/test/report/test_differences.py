"""Recordings are compared together with the differing values of their configurations."""

from __future__ import annotations

from pathlib import Path

from omni_tools.report.recording import differing_values


def test_values_that_are_not_the_same_are_named(tmp_path: Path) -> None:
    texts = {
        "a": "seed: 1\nground: {friction: 1.0, texture: {kind: cork}}",
        "b": "seed: 1\nground: {friction: 0.5, texture: {kind: cork}}\nimu: {enabled: true}",
    }
    for name, text in texts.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "configuration.yaml").write_text(text)
    found, problems = differing_values([tmp_path / name for name in texts])
    assert found == {"ground.friction": ["1.0", "0.5"], "imu.enabled": ["", "true"]}
    assert problems == {}
    assert differing_values([tmp_path / "a", tmp_path / "a"]) == ({}, {})


def test_an_unreadable_configuration_is_named_and_not_compared(tmp_path: Path) -> None:
    for name, text in {"a": "seed: 1", "b": "seed: ["}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "configuration.yaml").write_text(text)
    found, problems = differing_values([tmp_path / "a", tmp_path / "b", tmp_path])
    assert found == {}
    assert "is not valid YAML" in problems.pop(tmp_path / "b")
    assert problems == {tmp_path: "there is no configuration.yaml next to the recording"}
