"""Command-line options of a placement of line cameras."""

from omni_core import configuration
from omni_core.commands import command_options


class PlacementOptions(configuration.Configuration):
    """Command-line options: chassis, cameras, motions and ground."""

    vehicle: str = configuration.parameter("mecanum_forklift")
    """vehicle: a file of config/vehicles/, a path, or a vehicle's folder"""
    sensors: int | None = configuration.parameter(None, minimum=3, maximum=8)
    """number of cameras; the three components of the twist require at least three cameras
    (default: 3, or the number in the file of --check)"""
    type: str | None = configuration.parameter(None)
    """type of camera: a file of config/sensors/ such as `generic`, `lis_770i` or `s3901`, or a path
    that ends in .yaml; the positions in the file are evaluated too (default: `generic`, or the
    type in the file of --check)"""
    check: tuple[str, ...] = configuration.parameter(())
    """evaluate the placement in this file, as for --type; exit code 1 if it is singular"""
    redundant: bool = configuration.parameter(False)
    """minimize the error after the failure of the most important camera (at least four cameras)"""
    speed: float | None = command_options.option(None, metavar="M/S", above=0.0, maximum=1000.0)
    """speed of the motions in which the cameras measure (default: 10, or the highest measurable
    speed if it is lower)"""
    yaw_rate: float = command_options.option(1.0, metavar="RAD/S", minimum=0.0, maximum=100.0)
    """yaw rate in the turning motion"""
    mix: str = command_options.option("1:1:1:1", metavar="A:B:C:D")
    """shares of straight, sideways, diagonal and turning motion"""
    ground: str = command_options.option("cork", metavar="KIND")
    """ground on which the camera's error is measured"""
    noise: float = command_options.option(1.0, metavar="LEVELS", minimum=0.0, maximum=100.0)
    """noise of the camera in gray levels"""
    housing: float = command_options.option(0.02, metavar="M", minimum=0.0, maximum=1.0)
    """size of a camera's housing around its field of view"""
    clearance: float = command_options.option(0.02, metavar="M", minimum=0.0, maximum=1.0)
    """distance to the edge of the chassis, to wheels and to other cameras"""
    confirm: bool = configuration.parameter(False)
    """simulate every placement with rendered lines, and compare the measured with the expected
    error"""
    seed: int = configuration.parameter(1, minimum=0)
    """seed of search, ground and noise"""
