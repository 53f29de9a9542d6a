"""Options of a placement of line cameras, as a command line gives them."""

from __future__ import annotations

from dataclasses import dataclass

from omni_platform import command_options, configuration


@dataclass(frozen=True, kw_only=True)
class PlacementOptions(configuration.Configuration):
    """Chassis, cameras, motions and ground for which line cameras are placed."""

    vehicle: str = configuration.parameter(
        "mecanum_forklift",
        description="a file of config/vehicles/, or a path that ends in .yaml",
    )
    sensors: int | None = configuration.parameter(
        None, description="how many, 3 to 8 (default: 3, or as --check)"
    )
    type: str | None = configuration.parameter(
        None,
        description="type of camera: a file of config/sensors/ such as generic, lis_770i or s3901, "
        "or a path that ends in .yaml; its places are judged too (default: generic, or as --check)",
    )
    check: tuple[str, ...] = configuration.parameter(
        (),
        description="judge this placement, a file as for --type; exit code 1 if one is singular",
    )
    redundant: bool = configuration.parameter(
        False,
        description="minimize the error without the camera whose failure is the worst; four or "
        "more",
    )
    speed: float | None = command_options.option(
        None,
        metavar="M/S",
        description="of the motions to design for (default: 10, or less if the cameras are too "
        "slow)",
    )
    yaw_rate: float = command_options.option(
        1.0,
        metavar="RAD/S",
        description="of the turning motion",
        minimum=0.0,
        maximum=100.0,
    )
    mix: str = command_options.option(
        "1:1:1:1",
        metavar="A:B:C:D",
        description="shares of straight, sideways, diagonal and turning motion",
    )
    ground: str = command_options.option(
        "cork", metavar="KIND", description="on which the camera's error is measured"
    )
    noise: float = command_options.option(
        1.0,
        metavar="LEVELS",
        description="of the camera in gray levels",
        minimum=0.0,
        maximum=100.0,
    )
    housing: float = command_options.option(
        0.02,
        metavar="M",
        description="of a camera, around its field of view",
        minimum=0.0,
        maximum=1.0,
    )
    clearance: float = command_options.option(
        0.02,
        metavar="M",
        description="to the edge of the chassis, wheels and other cameras",
        minimum=0.0,
        maximum=1.0,
    )
    confirm: bool = configuration.parameter(
        False, description="drive every placement over rendered lines and compare the errors"
    )
    seed: int = configuration.parameter(1, description="of search, ground and noise", minimum=0)
