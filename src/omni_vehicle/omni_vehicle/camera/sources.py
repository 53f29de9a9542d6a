"""Sources of frames: V4L2 cameras and video files (OpenCV), GenICam cameras (Harvester), arrays.

Each library is imported only when a source that needs it is opened. The odometry runs without them.
"""

import dataclasses
import importlib
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from omni_core.configuration import ConfigurationError
from omni_vehicle.camera.configuration import CameraConfiguration

VIDEOS = (".avi", ".mp4", ".mkv", ".mov", ".m4v")

INSTALL = "./omni install {}"
"""Command that installs an optional library; the placeholder is the name of its lock file."""

_RAW = ("GRAY", "Y8  ", "Y10 ", "Y12 ", "Y16 ")  # V4L2 formats that are not converted to color
_FETCH_TIMEOUT = 0.5  # timeout for a frame of a GenICam camera [s]
_DEFAULT_FORMAT = "Mono8"
_MANUAL = 1.0  # V4L2 value for manual exposure; exposure times are in units of 100 us


class CameraError(Exception):
    """A camera cannot be opened or has stopped; the message states the reason."""


@dataclasses.dataclass(frozen=True)
class Frame:
    """A picture taken by a camera.

    Attributes:
        picture: gray levels, shape (height, width).
        number: frame number from the camera driver; None if frames are not numbered.
        stamp_ns: stamp from the camera driver on the monotonic clock [ns]; None without a stamp.
    """

    picture: NDArray[np.uint8] | NDArray[np.uint16]
    number: int | None = None
    stamp_ns: int | None = None


class FrameSource(Protocol):
    """Interface of a source of frames: a camera or a file.

    Attributes:
        played: whether the source is a file, from which frames can be read faster than in real
            time.
        ended: whether the source has no more frames.
    """

    played: bool
    ended: bool

    def read(self) -> Frame | None:
        """Wait for the next frame and return it; None after a timeout or at the end.

        Raises:
            CameraError: the camera has stopped.
        """

    def close(self) -> None:
        """Release the camera."""


def open_source(configuration: CameraConfiguration) -> FrameSource:
    """Open the camera or file that a configuration names, and return it.

    Raises:
        ConfigurationError: the source does not exist, or its library is missing.
    """
    name = configuration.source
    path = Path(name.partition("#")[0]).expanduser()
    if path.suffix == ".cti":
        return GenicamSource(path, name.partition("#")[2], configuration)
    if path.suffix == ".npy":
        return ArraySource(path)
    device = name.isdigit() or name.startswith("/dev/")
    if not device and path.suffix.lower() not in VIDEOS:
        kinds = ", ".join((".cti", ".npy", *VIDEOS))
        raise ConfigurationError("source", f"{name!r} is neither a device nor a file ({kinds})")
    return VideoSource(int(name) if name.isdigit() else str(path), device, configuration)


class ArraySource:
    """Pictures in a NumPy file, an array of three dimensions (picture, row, column)."""

    played = True

    def __init__(self, path: Path) -> None:
        """Open the NumPy file."""
        self.ended = False
        try:
            self._pictures = np.load(path, mmap_mode="r", allow_pickle=False)
        except (OSError, ValueError) as error:
            raise ConfigurationError("source", f"{path} cannot be read: {error}") from None
        if self._pictures.ndim != 3:
            raise ConfigurationError(
                "source", f"{path} has {self._pictures.ndim} dimensions; pictures must have three"
            )
        self._next = 0

    def read(self) -> Frame | None:
        """Return the next picture, None at the end of the file."""
        if self._next == len(self._pictures):
            self.ended = True
            return None
        self._next += 1
        return Frame(np.array(self._pictures[self._next - 1]), self._next)

    def close(self) -> None:
        """Do nothing, because no device is open."""


class VideoSource:
    """A V4L2 or UVC camera, or a video file, read with OpenCV."""

    def __init__(self, source: int | str, device: bool, configuration: CameraConfiguration) -> None:
        """Open the camera and request size, rate, format and exposure."""
        self._cv2 = _load("cv2", "OpenCV", "opencv")
        self._name = str(source)
        self.played = not device
        self.ended = False
        if not device and not Path(str(source)).exists():
            raise ConfigurationError("source", f"there is no file {source}")
        backend = self._cv2.CAP_V4L2 if device else self._cv2.CAP_ANY
        self._capture = self._cv2.VideoCapture(source, backend)
        if not self._capture.isOpened():
            raise ConfigurationError(
                "source",
                f"{source} cannot be opened: "
                + ("it is missing or in use" if device else "OpenCV cannot read it as a video"),
            )
        if device:
            self._request(configuration)
        self._count = 0

    def _request(self, requested: CameraConfiguration) -> None:
        cv2, capture = self._cv2, self._capture
        code = requested.pixel_format.upper().ljust(4)
        if requested.pixel_format:
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter_fourcc(*code[:4]))
            if code in _RAW:
                capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        for key, value in (
            (cv2.CAP_PROP_FRAME_WIDTH, requested.frame_width),
            (cv2.CAP_PROP_FRAME_HEIGHT, requested.frame_height),
        ):
            if value:
                capture.set(key, value)
        capture.set(cv2.CAP_PROP_FPS, requested.frame_rate)
        if requested.exposure:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL)
            capture.set(cv2.CAP_PROP_EXPOSURE, 1e4 * requested.exposure)

    def read(self) -> Frame | None:
        """Return the next frame, converted to gray levels; None at the end of a file."""
        there, picture = self._capture.read()
        if not there:
            if self.played:
                self.ended = True
                return None
            raise CameraError(f"{self._name} delivers no more frames: it was unplugged or reset")
        if picture.ndim == 3 and picture.shape[2] > 1:
            picture = self._cv2.cvtColor(picture, self._cv2.COLOR_BGR2GRAY)
        gray = picture.reshape(picture.shape[:2])  # raw formats may keep a third dimension
        self._count += 1
        if self.played:
            return Frame(gray, self._count)
        # V4L2 gives buffers monotonic stamps; other backends return 0.
        stamp_ms = float(self._capture.get(self._cv2.CAP_PROP_POS_MSEC))
        return Frame(gray, None, round(1e6 * stamp_ms) if stamp_ms > 0.0 else None)

    def close(self) -> None:
        """Release the camera."""
        self._capture.release()


class GenicamSource:
    """A GenICam camera (GigE, USB3 Vision, Camera Link), read by Harvester and a GenTL producer."""

    played = False
    ended = False

    def __init__(self, producer: Path, serial: str, configuration: CameraConfiguration) -> None:
        """Open the camera with this serial number, or the first camera if the number is empty."""
        core = _load("harvesters.core", "Harvester", "genicam")
        if not producer.exists():
            raise ConfigurationError("source", f"there is no GenTL producer {producer}")
        self._harvester = core.Harvester()
        self._timeout = importlib.import_module("genicam.gentl").TimeoutException
        self._harvester.add_file(str(producer))
        self._harvester.update()
        serials = [info.serial_number for info in self._harvester.device_info_list]
        if not serials or (serial and serial not in serials):
            self._harvester.reset()
            known = ", ".join(map(str, serials)) or "none"
            raise ConfigurationError(
                "source", f"{producer} finds no camera {serial or ''}; cameras found: {known}"
            )
        self._camera = self._harvester.create({"serial_number": serial} if serial else 0)
        try:
            self._request(self._camera.remote_device.node_map, configuration)
            _refuse_encoder(self._camera.remote_device.node_map)
        except ConfigurationError:
            self._camera.destroy()
            self._harvester.reset()
            raise
        self._camera.start()

    @staticmethod
    def _request(nodes: Any, requested: CameraConfiguration) -> None:
        wishes: dict[str, Any] = {
            "PixelFormat": requested.pixel_format or _DEFAULT_FORMAT,
            "Width": requested.frame_width,
            "Height": requested.frame_height,
            "ExposureTime": 1e6 * requested.exposure,
            "AcquisitionFrameRate": requested.frame_rate,
        }
        for name, value in wishes.items():
            if not value:
                continue
            if not nodes.has_node(name):
                if name == "AcquisitionFrameRate":
                    continue  # a triggered camera has no frame rate
                raise ConfigurationError("source", f"the camera has no {name}")
            try:
                nodes.get_node(name).value = value
            except Exception as error:  # producers raise any type of exception
                words = " ".join(str(error).split())
                raise ConfigurationError(
                    "source", f"the camera refuses {name} = {value}: {words}"
                ) from None

    def read(self) -> Frame | None:
        """Return the next frame of the camera; None after a timeout."""
        try:
            buffer = self._camera.fetch(timeout=_FETCH_TIMEOUT)
        except self._timeout:
            return None
        with buffer:
            part = buffer.payload.components[0]
            if part.num_components_per_pixel != 1:
                raise CameraError(f"pixels are {part.data_format}, not gray: set pixel_format")
            picture = np.array(part.data).reshape(part.height, part.width)
            return Frame(picture, int(buffer.frame_id))

    def close(self) -> None:
        """Stop the camera and release it."""
        self._camera.stop()
        self._camera.destroy()
        self._harvester.reset()


def _refuse_encoder(nodes: Any) -> None:
    """Refuse a GenICam camera that an encoder triggers.

    Raises:
        ConfigurationError: a trigger that is on has an encoder as its source.
    """
    if not all(map(nodes.has_node, ("TriggerSelector", "TriggerMode", "TriggerSource"))):
        return
    selector = nodes.get_node("TriggerSelector")
    chosen = selector.value
    for trigger in selector.symbolics:
        selector.value = trigger
        mode, source = (nodes.get_node(f"Trigger{name}").value for name in ("Mode", "Source"))
        if mode == "On" and "encoder" in str(source).lower():
            raise ConfigurationError(
                "source",
                f"{source} triggers the camera ({trigger}): lines at equal distances have no "
                "constant rate, and there are none while its wheel is locked; set TriggerMode to "
                "Off, or trigger it by a clock",
            )
    selector.value = chosen


def _load(module: str, library: str, lock: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ConfigurationError(
            "source", f"needs {library}, which is not installed: {INSTALL.format(lock)}"
        ) from None
