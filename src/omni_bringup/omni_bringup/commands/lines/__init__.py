"""``./omni lines``: import, show and correct lines of real cameras.

Import the lines of real cameras from files into a recording that `omni replay` can read, show the
lines of a recording, and compute tables that correct the fixed pattern of a camera.
"""

PACKAGE = __name__
