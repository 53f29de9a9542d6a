"""``./omni lines``: take the lines of real cameras into recordings, and look at them.

Take the lines of real cameras from files into a recording that `omni replay` and the odometry take,
and look at what a camera saw.
"""

from __future__ import annotations

PACKAGE = __name__
