"""Command-line options of a placement of line cameras."""

from dataclasses import dataclass

from omni_platform import command_options, configuration


@dataclass(frozen=True, kw_only=True)
class PlacementOptions(configuration.Configuration):
    """Chassis, cameras, motions and ground for which line cameras are placed."""

    vehicle: str = configuration.parameter("mecanum_forklift")
    """a file of config/vehicles/, or a path that ends in .yaml"""
    sensors: int | None = configuration.parameter(None)
    """how many, 3 to 8 (default: 3, or as --check)"""
    type: str | None = configuration.parameter(None)
    """type of camera: a file of config/sensors/ such as generic, lis_770i or s3901, or a path that
    ends in .yaml; its places are judged too (default: generic, or as --check)"""
    check: tuple[str, ...] = configuration.parameter(())
    """judge this placement, a file as for --type; exit code 1 if one is singular"""
    redundant: bool = configuration.parameter(False)
    """minimize the error without the camera whose failure is the worst; four or more"""
    speed: float | None = command_options.option(None, metavar="M/S")
    """of the motions to design for (default: 10, or less if the cameras are too slow)"""
    yaw_rate: float = command_options.option(1.0, metavar="RAD/S", minimum=0.0, maximum=100.0)
    """of the turning motion"""
    mix: str = command_options.option("1:1:1:1", metavar="A:B:C:D")
    """shares of straight, sideways, diagonal and turning motion"""
    ground: str = command_options.option("cork", metavar="KIND")
    """on which the camera's error is measured"""
    noise: float = command_options.option(1.0, metavar="LEVELS", minimum=0.0, maximum=100.0)
    """of the camera in gray levels"""
    housing: float = command_options.option(0.02, metavar="M", minimum=0.0, maximum=1.0)
    """of a camera, around its field of view"""
    clearance: float = command_options.option(0.02, metavar="M", minimum=0.0, maximum=1.0)
    """to the edge of the chassis, wheels and other cameras"""
    confirm: bool = configuration.parameter(False)
    """drive every placement over rendered lines and compare the errors"""
    seed: int = configuration.parameter(1, minimum=0)
    """of search, ground and noise"""
