"""Imports and code that the declaration of kernels needs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from omni_core.compilation import NUMBA_SERIES
from omni_core.kernels import njit
from omni_core.quantities import FloatArray

_PROGRAM = """
import sys
import numpy as np
import scipy
from omni_core.kernels import kernel

@kernel
def doubled(values):
    return 2.0 * values

@kernel
def squared(values):
    return values @ values

@kernel
def spectrum(values):
    return scipy.fft.rfft(values)

doubled(np.eye(2))
print("scipy.linalg" in sys.modules, "scipy.fft" in sys.modules)
print(squared(2.0 * np.eye(2))[1, 1])
import rocket_fft
print(spectrum(np.ones(4))[0].real)
"""


def test_only_who_needs_them_loads_products_of_matrices_and_transforms(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(_PROGRAM)
    result = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, check=True, timeout=120
    )
    assert result.stdout.split() == ["False", "False", "4.0", "4.0"]


def test_another_series_of_numba_is_refused_with_the_one_that_is_needed() -> None:
    program = "import numba; numba.__version__ = '0.99.1'; import omni_core.kernels"
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=120
    )
    assert result.returncode == 1
    last = result.stderr.splitlines()[-1]
    assert last.startswith("ImportError: numba 0.99.1 is installed")
    assert f"pip install 'numba=={NUMBA_SERIES}.*'" in last


def _store(into: FloatArray, values: FloatArray) -> None:
    into[1:] = values


def test_an_array_of_another_shape_is_refused_without_code_that_formats_shapes() -> None:
    store = njit(_store)
    with pytest.raises(ValueError, match="cannot assign an array to a slice of another shape"):
        store(np.zeros(4), np.zeros(5))
    (code,) = store.inspect_llvm().values()
    assert "unicode" not in code
