"""Demands of the scripted driver: constant velocity and a stop at a given time, or a table."""

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, parameter, section

FARTHEST = 1.0e4  # m; limit on the coordinates of a vehicle, up to which grounds can be rendered


class DemandConfiguration(Configuration):
    """Table of the driver's demands over time, interpolated linearly.

    After the last row, the commanded velocity is zero and the pedal keeps its position. While
    the pedal is at or above ``vehicle.drive.clutch_threshold``, the motor drives are disengaged, so
    the velocities have no effect.
    """

    time: tuple[float, ...] = parameter((), unit="s", minimum=0.0, maximum=3600.0)
    """Times of the rows, in increasing order"""
    forward: tuple[float, ...] = parameter((), unit="m/s", minimum=-50.0, maximum=50.0)
    """Velocity forward"""
    left: tuple[float, ...] = parameter((), unit="m/s", minimum=-50.0, maximum=50.0)
    """Velocity to the left"""
    turn: tuple[float, ...] = parameter((), unit="rad/s", minimum=-12.6, maximum=12.6)
    """Yaw rate"""
    pedal: tuple[float, ...] = parameter((), minimum=0.0, maximum=1.0)
    """Position of the brake pedal, 0 to 1"""

    def check_consistency(self) -> None:
        """Check that the table is valid.

        Raises:
            ConfigurationError: a column is invalid; the message names the column.
        """
        for name in ("forward", "left", "turn", "pedal"):
            column = getattr(self, name)
            if len(column) != len(self.time):
                raise ConfigurationError(
                    name, f"has {len(column)} rows but must have {len(self.time)}, like time"
                )
        if np.any(np.diff(self.time) <= 0.0):
            raise ConfigurationError("time", "must increase from row to row")


class ManeuverConfiguration(Configuration):
    """Demands of the scripted driver during a run."""

    x: float = parameter(0.0, unit="m", minimum=-FARTHEST, maximum=FARTHEST)
    """Start position of base_link in the world frame, x"""
    y: float = parameter(0.0, unit="m", minimum=-FARTHEST, maximum=FARTHEST)
    """Start position of base_link in the world frame, y"""
    heading_deg: float = parameter(0.0, unit="deg", minimum=-360.0, maximum=360.0)
    """Heading of the body at the start, counter-clockwise from the x axis"""
    speed: float = parameter(10.0, unit="m/s", minimum=0.0, maximum=50.0)
    """Speed before braking"""
    direction_deg: float = parameter(0.0, unit="deg", minimum=-360.0, maximum=360.0)
    """Direction of motion, counter-clockwise from the body's forward axis"""
    yaw_rate_deg: float = parameter(0.0, unit="deg/s", minimum=-720.0, maximum=720.0)
    """Yaw rate before braking, counter-clockwise"""
    hold_world_direction: bool = parameter(False)
    """Whether the direction of motion is constant in the world while the body turns
    (turn-while-translate); otherwise it turns with the body"""
    brake_time: float = parameter(1.0, unit="s", minimum=0.0, maximum=3600.0)
    """Time at which the driver starts to press the brake pedal"""
    pedal: float = parameter(1.0, minimum=0.0, maximum=1.0)
    """Position of the brake pedal while braking"""
    pedal_ramp_time: float = parameter(0.0, unit="s", minimum=0.0, maximum=60.0)
    """Time in which the driver presses the pedal from 0 to the position `pedal`"""
    demands: DemandConfiguration = section(DemandConfiguration)
    """Table that replaces speed, direction, yaw rate, pedal and their times. In an experiment or
    with --set, the name of a CSV file or of a recording may be given instead"""

    @property
    def earliest_end(self) -> float:
        """Time before which a run does not end, even if the vehicle is at rest [s]."""
        return self.demands.time[-1] if self.demands.time else 0.0

    def check_consistency(self) -> None:
        """Check that a table of demands is not combined with a direction fixed in the world.

        Raises:
            ConfigurationError: both are given; the message names the parameter.
        """
        if self.demands.time and self.hold_world_direction:
            raise ConfigurationError(
                "hold_world_direction", "cannot be combined with demands, which turn with the body"
            )
