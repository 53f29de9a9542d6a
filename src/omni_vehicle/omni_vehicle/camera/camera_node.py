"""ROS node that reads frames of a real camera and publishes batches of lines.

The README of this package describes the contract: topics, types, QoS settings and parameters.
"""

import threading
import time
from collections import deque
from functools import partial

from rclpy.node import Node

from omni_core import topics
from omni_core.configuration import ConfigurationError
from omni_core.signals import LineBatch
from omni_ros.frames import FrameConfiguration, prefix_frames
from omni_ros.line_images import camera_info, line_image
from omni_ros.parameters import declare_configuration
from omni_ros.process import NodeError, Spinner, StartupConfiguration, run_process
from omni_ros.qos import advertise
from omni_ros.status import ERROR, OK, WARN, Status, StatusReporter
from omni_vehicle.camera.assembler import LineAssembler
from omni_vehicle.camera.configuration import CameraConfiguration
from omni_vehicle.camera.cut import FrameError
from omni_vehicle.camera.sources import CameraError, Frame, open_source

_MOST_WAITING = 64  # limit on the number of frames in the queue; further frames are lost
_OFF_RATE = 0.01  # relative error of the configured frame rate that causes a warning [1]
_OLDEST_NS = 2_000_000_000  # limit on the age of a driver's stamp; an older stamp is ignored [ns]
_LONGEST_END = 2.0  # limit on the time to wait for the release of the device [s]


class CameraNode(Node):
    """Reads a camera in a separate thread and publishes its lines."""

    def __init__(self) -> None:
        super().__init__("line_camera")
        self.startup = declare_configuration(self, StartupConfiguration)
        self._configuration = configuration = declare_configuration(self, CameraConfiguration)
        self._prefix = declare_configuration(self, FrameConfiguration).frame_prefix
        self._assembler = LineAssembler(configuration)
        self._source = open_source(configuration)
        name = configuration.sensor
        self._lines = advertise(self, topics.lines(name))
        self._info = advertise(self, topics.camera_info(name))
        self._status = StatusReporter(
            self, Status(ERROR, f"no frame received from {configuration.source} yet")
        )
        self.outputs = (self._lines,)
        self._frames: deque[tuple[Frame, int]] = deque()
        self._overrun = 0
        self._lost = 0  # number of lost frames at the last report
        self._failure = ""
        self._ended = False
        self._stop = threading.Event()
        self._reader = threading.Thread(target=self._read, name="camera", daemon=True)

    def run(self, spinner: Spinner) -> None:
        """Publish lines until the end of the file or a shutdown request.

        Raises:
            NodeError: the camera has stopped delivering frames.
        """
        self._reader.start()
        try:
            while not spinner.stop:
                ended = self._ended  # read before the queue, so that all frames are published
                self._publish_all()
                if ended:
                    break
                spinner.spin_once()
        finally:
            self._stop.set()
            self._reader.join(_LONGEST_END)
            if not self._reader.is_alive():
                self._source.close()
        if self._failure:
            raise NodeError(f"{self._configuration.sensor}: {self._failure}")
        self._send(self._assembler.finish())

    def _read(self) -> None:
        """Read frames in the background thread, and store them with their arrival times.

        Any other work in this thread could cause lost frames.
        """
        try:
            begin_ns = 0
            while not self._stop.is_set() and not self._source.ended:
                frame = self._source.read()
                if frame is None:
                    continue
                now_ns = int(self.get_clock().now().nanoseconds)
                if self._source.played and frame.number is not None:
                    begin_ns = begin_ns or now_ns
                    due_ns = begin_ns + round(1e9 * frame.number / self._configuration.frame_rate)
                    self._stop.wait(max(0.0, 1e-9 * (due_ns - now_ns)))
                    now_ns = due_ns
                elif frame.stamp_ns is not None:
                    age_ns = time.monotonic_ns() - frame.stamp_ns
                    now_ns -= age_ns if 0 <= age_ns < _OLDEST_NS else 0
                if len(self._frames) < _MOST_WAITING:
                    self._frames.append((frame, now_ns))
                else:
                    self._overrun += 1
                self._wake()
        except CameraError as error:
            self._failure = str(error)
        self._ended = True
        self._wake()

    def _wake(self) -> None:
        """Wake the publishing thread."""
        if self.executor is not None:
            self.executor.create_task(lambda: None)

    def _publish_all(self) -> None:
        while self._frames:
            frame, arrival_ns = self._frames.popleft()
            known = self._assembler.pixels
            try:
                batches = self._assembler.take(frame.picture, arrival_ns, frame.number)
            except FrameError as error:
                source = self._configuration.source
                raise ConfigurationError("rows", f"a frame of {source} {error}") from None
            if not known:
                self._announce()
            self._send(batches)
            self._report(arrival_ns, frame)

    def _announce(self) -> None:
        """Publish the camera_info and log the size and rate of the lines."""
        pixels, rate = self._assembler.pixels, self._assembler.line_rate
        info = camera_info(self._configuration.sensor, pixels, self._configuration.length)
        prefix_frames(info, self._prefix)
        self._info.publish(info)
        name = self._configuration.sensor
        self.get_logger().info(
            f"{name}: lines of {pixels} px, {rate:g} lines/s; the odometry needs "
            f"sensors.{name}.pixels: {pixels}, line_rate: {rate:g}"
        )

    def _send(self, batches: list[LineBatch]) -> None:
        frame = self._prefix + self._configuration.sensor
        for batch in batches:
            self._lines.publish(line_image(batch.stamp_ns, frame, batch.lines))

    def _report(self, stamp_ns: int, frame: Frame) -> None:
        """Update the status of the camera for the diagnostics."""
        clock, nominal = self._assembler.clock, self._configuration.frame_rate
        lost = clock.lost + self._overrun
        off = clock.rate / nominal - 1.0
        values = {
            "frames per second": f"{clock.rate:.4g} (configured {nominal:g})",
            "lines per second": f"{self._assembler.line_rate:g}",
            "frames lost": f"{clock.lost}, and {self._overrun} because of high CPU load",
            "clock resets": str(clock.resets),
            "mean gray level": f"{frame.picture.mean():.1f}",
        }
        words = []
        if lost > self._lost:
            words.append(f"{lost - self._lost} frames lost")
        if abs(off) > _OFF_RATE:
            words.append(
                f"frame rate {100.0 * off:+.1f} % off its configured value: set frame_rate, and "
                "do not trigger the camera by an encoder"
            )
        level = WARN if words else OK
        if clock.is_off_rate:
            level = ERROR
            words.append("no lines are published")
        key = (lost, clock.resets, abs(off) > _OFF_RATE)
        self._lost = lost
        self._status.update(stamp_ns, key, Status(level, "; ".join(words) or "delivering", values))


def run(node: CameraNode, spinner: Spinner) -> None:
    """Publish lines until the end of a file, or until a signal requests shutdown."""
    node.startup.await_subscribers(node.outputs, spinner)
    node.run(spinner)


main = partial(run_process, CameraNode, run)


if __name__ == "__main__":
    raise SystemExit(main())
