"""Batches of camera lines along a trajectory, rendered in the background."""

from collections.abc import Iterator, Mapping
from functools import partial

from omni_platform.background import in_background
from omni_platform.quantities import FloatArray
from omni_platform.signals import LineBatch
from omni_sim.camera.camera import LineCameraArray
from omni_sim.camera.clock import LineClock
from omni_sim.camera.poses import interpolate_poses, interpolate_velocities

_Exposure = tuple[int, FloatArray, FloatArray | None]
"""Stamp of the newest line [ns], then poses and velocities as in `LineCamera.lines`."""


class LineExposures:
    """Renders the lines of all cameras, one control period after another.

    Attributes:
        cameras: the cameras.
    """

    def __init__(self, cameras: LineCameraArray, step_ns: float, *, blurred: bool) -> None:
        """Start the clocks of the cameras at time 0.

        Args:
            cameras: the cameras.
            step_ns: time between two rows of a trajectory [ns].
            blurred: whether to compute velocities for motion blur.
        """
        self.cameras = cameras
        self._step_ns = step_ns
        self._blurred = blurred
        rates = {camera.sensor.line_rate for camera in cameras.cameras.values()}
        self._clocks = {rate: LineClock(rate) for rate in rates}
        self._batches = _Batches({}, cameras)

    def complete(self) -> None:
        """Render all remaining lines; the noise of the next lines depends on their number."""
        for name in self._batches:
            self._batches[name]

    def expose(self, trajectory: FloatArray, start_ns: int, end_ns: int) -> Mapping[str, LineBatch]:
        """Return the lines of each camera with times in (start, end]; call `complete` first.

        Args:
            trajectory: trajectory from `Vehicle.advance`, shape (n + 1, 6).
            start_ns: time of its first row [ns]; -1 to include the line at time 0.
            end_ns: time of its last row [ns].
        """
        taken: dict[float, _Exposure] = {}
        for rate, clock in self._clocks.items():
            first, last = clock.lines_in(start_ns, end_ns)
            times = clock.times_ns(first, last)
            along = (trajectory, max(start_ns, 0), self._step_ns, times)
            poses, velocities = interpolate_poses(*along), None
            if self._blurred:
                velocities = interpolate_velocities(*along)
            taken[rate] = clock.stamp_ns(last - 1), poses, velocities
        cameras = self.cameras.cameras.items()
        exposures = {name: taken[camera.sensor.line_rate] for name, camera in cameras}
        self._batches = _Batches(exposures, self.cameras)
        return self._batches


class _Batches(Mapping[str, LineBatch]):
    """Batches of the cameras, rendered in the background, or on access if not yet rendered.

    The odometry can therefore process the batch of one camera while the next one is rendered.
    """

    def __init__(self, exposures: Mapping[str, _Exposure], cameras: LineCameraArray) -> None:
        # The background thread starts with the last camera, because readers start with the first
        # one.
        self._rendering = {
            name: in_background(partial(_render, cameras, name, exposures[name]))
            for name in reversed(tuple(exposures))
        }
        self._names = tuple(exposures)
        self._made: dict[str, LineBatch] = {}

    def __getitem__(self, name: str) -> LineBatch:
        if name not in self._made:
            self._made[name] = self._rendering[name]()
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def _render(cameras: LineCameraArray, name: str, exposure: _Exposure) -> LineBatch:
    stamp_ns, poses, velocities = exposure
    return LineBatch(stamp_ns, cameras.render_next(name, poses, velocities))
