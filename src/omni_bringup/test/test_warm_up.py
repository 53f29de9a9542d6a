"""Kernels in the cache whose types are no more are forgotten; all others are kept."""

from __future__ import annotations

import pickle
import sys
import types
from pathlib import Path

import pytest

from omni_bringup.warm_up import forget_lost_types


def index(folder: Path, name: str, kind: type) -> Path:
    """Write an index as numba does: its version, then stamp and kernels by their types."""
    path = folder / f"loop_0123/{name}.nbi"
    path.parent.mkdir(exist_ok=True)
    kernels = {((kind,), ("x86_64", "cpu", "")): f"{name}.1.nbc"}
    path.write_bytes(pickle.dumps("0.68.1") + pickle.dumps(((0.0, 1), kernels)))
    return path


@pytest.mark.parametrize("whole_module", [True, False])
def test_kernels_of_a_type_that_is_gone_are_forgotten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole_module: bool
) -> None:
    module = types.ModuleType("module_before_an_update")
    kind = type("Moved", (), {})
    kind.__module__ = module.__name__
    module.Moved = kind  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    kept, lost = index(tmp_path, "kept", float), index(tmp_path, "lost", kind)
    forget_lost_types(tmp_path)
    assert kept.exists()
    assert lost.exists()
    if whole_module:
        monkeypatch.delitem(sys.modules, module.__name__)
    else:
        del module.Moved
    forget_lost_types(tmp_path)
    assert kept.exists()
    assert not lost.exists()
