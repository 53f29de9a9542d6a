"""What declaring kernels costs a process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

_PROGRAM = """
import sys
import numpy as np
from omni_platform.kernels import kernel

@kernel
def doubled(values):
    return 2.0 * values

@kernel
def squared(values):
    return values @ values

doubled(np.eye(2))
print("scipy.linalg" in sys.modules)
print(squared(2.0 * np.eye(2))[1, 1])
"""


def test_only_products_of_matrices_load_a_blas(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(_PROGRAM)
    result = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, check=True, timeout=120
    )
    assert result.stdout.split() == ["False", "4.0"]
