"""Parameters of the texture of a ground."""

import math

from omni_core.configuration import Configuration, ConfigurationError, parameter

KINDS = (
    *("cork", "asphalt", "stone", "wood", "plastic", "metal", "walking_tile", "dry_earth"),
    *("worn_asphalt", "concrete", "wet_concrete", "gravel", "sand", "grass", "bark", "brick"),
    *("cobble", "planks", "carpet", "terrazzo", "slabs", "tile", "wet_asphalt"),
    *("sealed_concrete", "epoxy", "flake_epoxy"),
)
"""Kinds of grounds that `materials` paints."""


PICTURE = "picture"


INCH = 0.0254
"""Length of an inch [m]."""


BLOCK = 32
"""If the number of texels per period follows from dpi, it is a multiple of this number. Blocks of
texels can then be merged into coarser texels."""


MOST_TEXELS = 20480
"""Limit on the number of texels per period, which limits the memory."""


FEWEST_TEXELS = 256
"""Minimum number of texels per period."""


class TextureConfiguration(Configuration):
    """Texture of the ground: a material, or a user's picture."""

    kind: str = parameter("cork", choices=(*KINDS, PICTURE))
    """Kind of ground"""
    size: float = parameter(0.2, unit="m", minimum=0.05, maximum=1.0)
    """Period of a material's texture in x and y; a picture determines its own period"""
    texels: int = parameter(4096, unit="1", minimum=256, maximum=8192)
    """Number of texels per period of a material, in x and y"""
    seed: int = parameter(1, minimum=0)
    """Seed of a material's pattern"""
    picture: str = parameter("")
    """File of the ground if `kind` is `picture`: PNG, TIFF or JPEG"""
    dpi: float = parameter(0.0, minimum=0.0, maximum=50000.0)
    """Dots per inch on the ground, required for a picture. For a material, 0 means that `texels`
    sets the resolution; a larger value replaces it, and the period is rounded up to a multiple of
    32 dots"""

    def check_consistency(self) -> None:
        """Check that the options of a picture are complete and that the texels are not too many.

        Raises:
            ConfigurationError: a value is invalid; the message names the parameter.
        """
        if self.kind != PICTURE:
            if self.picture:
                raise ConfigurationError(
                    "picture", f"is only valid for the kind {PICTURE}, not {self.kind}"
                )
            if self.dpi > 0.0 and not FEWEST_TEXELS <= self.extent[0] <= MOST_TEXELS:
                raise ConfigurationError(
                    "dpi",
                    f"{self.dpi:g} dpi give {self.extent[0]} texels over {self.size:g} m, not "
                    f"{FEWEST_TEXELS} to {MOST_TEXELS}",
                )
        elif not self.picture:
            raise ConfigurationError("picture", f"the kind {PICTURE} needs the name of a file")
        elif self.dpi <= 0.0:
            raise ConfigurationError(
                "dpi", "a picture needs its dots per inch on the ground, such as 2400 for a scan"
            )

    @property
    def extent(self) -> tuple[int, float]:
        """Number of texels per period of a material, and the period [m]."""
        if self.dpi == 0.0:
            return self.texels, self.size
        texel = INCH / self.dpi
        # An excess of less than a hundredth of a texel is a rounding error.
        texels = math.ceil((self.size / texel - 0.01) / BLOCK) * BLOCK
        return texels, texels * texel
