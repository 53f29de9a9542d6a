"""Compilation, storage and linkage of numba kernels.

The module `code` uses private interfaces of numba, which change from one series of versions to the
next.

Raises:
    ImportError: the installed numba is of another series.
"""

import numba

NUMBA_SERIES = "0.68"
"""Series of numba for which this package is written, also in setup.py and package.xml"""

if not numba.__version__.startswith(f"{NUMBA_SERIES}."):
    raise ImportError(
        f"numba {numba.__version__} is installed, but omni_core needs numba {NUMBA_SERIES}; "
        f"install it: python -m pip install 'numba=={NUMBA_SERIES}.*'"
    )
