"""``./omni lines``: import lines of real cameras into recordings, and show them.

Import the lines of real cameras from files into a recording, which `omni replay` and the odometry
can read, and show the lines of a camera.
"""

PACKAGE = __name__
