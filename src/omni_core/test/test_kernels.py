"""The declaration of kernels needs one series of numba."""

from __future__ import annotations

import subprocess
import sys

from omni_core.compilation import NUMBA_SERIES


def test_another_series_of_numba_is_refused_with_the_one_that_is_needed() -> None:
    program = "import numba; numba.__version__ = '0.99.1'; import omni_core.kernels"
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=120
    )
    assert result.returncode == 1
    last = result.stderr.splitlines()[-1]
    assert last.startswith("ImportError: numba 0.99.1 is installed")
    assert f"pip install 'numba=={NUMBA_SERIES}.*'" in last
