"""Parameters of the camera node."""

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_vehicle.camera.cut import Cut, row_range


class CameraConfiguration(Configuration):
    """Parameters of a camera and of the selection of lines in its frames."""

    sensor: str = parameter()
    """Name of the line camera, one of the odometry's `sensors`; its lines are published on
    line_scan/<name>/lines"""
    source: str = parameter()
    """Source of the frames: a V4L2 device, such as /dev/video0, or its number; for GenICam, the
    .cti file of the GenTL producer, optionally with # and the camera's serial number; or, played in
    real time, a video file or an array of pictures (.npy)"""
    frame_rate: float = parameter(unit="1/s", above=0.0, maximum=1e5)
    """Frame rate, which is also requested from a device"""
    rows: str = parameter("")
    """Rows of a frame that are used, for example 240 or 236:244; empty for all rows"""
    band: bool = parameter(True)
    """Whether the rows are averaged to one line per frame; otherwise each row is a line"""
    columns: bool = parameter(False)
    """Whether the lines are the columns of the frame instead of its rows"""
    row_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Time between the rows of a frame if each row is a line, as with a rolling shutter; 0 for a
    constant rate across frames, as in the blocks of a line camera"""
    latency: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Time from the exposure of a frame's last row to its stamp (of the driver, if it provides one,
    otherwise of the arrival)"""
    batch: float = parameter(0.01, unit="s", above=0.0, maximum=1.0)
    """Time span of the lines in one message"""
    length: float = parameter(0.0, unit="m", minimum=0.0, maximum=1.0)
    """Field of view along the camera's axis, published in camera_info so that the odometry can
    check its own configuration; 0 if unknown"""
    frame_width: int = parameter(0, unit="px", minimum=0, maximum=16384)
    """Frame width requested from a device; 0 to keep the device's setting"""
    frame_height: int = parameter(0, unit="px", minimum=0, maximum=16384)
    """Frame height requested from a device; 0 to keep the device's setting"""
    pixel_format: str = parameter("")
    """Pixel format requested from a device: four characters of V4L2 (GRAY, Y16, YUYV, MJPG), or a
    name of GenICam (Mono8, Mono12); empty for Mono8 with GenICam, and the device's own setting with
    V4L2"""
    exposure: float = parameter(0.0, unit="s", minimum=0.0, maximum=1.0)
    """Exposure time requested from a device, which disables its automatic exposure; 0 to keep
    the device's setting"""

    @property
    def cut(self) -> Cut:
        """Selection of the lines in a frame, from the parameters `rows`, `band` and `columns`."""
        return Cut(row_range(self.rows, "rows"), self.band, self.columns)

    def check_consistency(self) -> None:
        """Check that a sensor and a source are given, and that the row parameters are valid."""
        if not self.sensor or not self.source:
            raise ConfigurationError("source" if self.sensor else "sensor", "is empty")
        if row_range(self.rows, "rows") == (0, 0):
            raise ConfigurationError("rows", "holds no row")
        if self.band and self.row_time > 0.0:
            raise ConfigurationError("row_time", "requires that rows are lines: set band to false")

    def line_rate(self, rows: int) -> float:
        """Return the line rate of frames that contain `rows` lines [1/s]."""
        return 1.0 / self.row_time if self.row_time > 0.0 else self.frame_rate * rows
