"""Disk cache of generated ground textures, so that each texture is generated only once.

The cache keeps no texture in memory, because a texture of high resolution needs too much of it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omni_core.configuration import to_mapping
from omni_core.files import replaced, user_folder
from omni_sim.texture import texture as ground
from omni_sim.texture.configuration import PICTURE, TextureConfiguration
from omni_sim.texture.picture import read_picture


class TextureCache:
    """Textures in a folder; the name of a texture's file contains a digest of its parameters.

    A file is an uncompressed NumPy archive with a CRC-32. If the file is missing or damaged, or its
    array has the wrong shape, the texture is generated again. Files are written atomically, so
    processes can share the folder. If the folder is not writable, textures are generated every
    time.

    Attributes:
        directory: folder of the cache, created when the first texture is stored.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    @classmethod
    def of_user(cls) -> TextureCache:
        """Return the cache that all workspaces of the user share, if its folder can be written.

        Otherwise, the cache is in the folder of the workspace's caches.
        """
        bases = (os.environ.get("XDG_CACHE_HOME") or "~/.cache", os.environ.get("OMNI_CACHE_DIR"))
        wanted = [Path(base, "omni_sim", "textures") for base in bases if base]
        return cls(user_folder("omni_sim", *wanted))

    def texture(self, configuration: TextureConfiguration) -> ground.GroundTexture:
        """Return a texture, from the cache if possible; a picture is read from its own file.

        Raises:
            ConfigurationError: the picture cannot be used.
        """
        if configuration.kind == PICTURE:
            return read_picture(configuration.picture, configuration.dpi)
        path = self.path(configuration)
        texels, size = configuration.extent
        gray = _read(path, texels)
        if gray is not None:
            return ground.GroundTexture(gray, size)
        texture = ground.generate_texture(configuration)
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            with replaced(path) as new, new.open("wb") as file:
                np.savez(file, gray=texture.gray)
        return texture

    def path(self, configuration: TextureConfiguration) -> Path:
        """Return the path of the file in which a texture is cached."""
        identity = json.dumps([ground.GENERATION, to_mapping(configuration)], sort_keys=True)
        digest = hashlib.sha256(identity.encode()).hexdigest()[:16]
        return self.directory / f"{configuration.kind}-{configuration.extent[0]}-{digest}.npz"


def _read(path: Path, texels: int) -> NDArray[np.uint8] | None:
    """Return the gray levels in a file, shape (texels, texels).

    Returns:
        Gray levels; None if the file is missing or damaged, or if its array has another shape.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            gray: NDArray[np.uint8] = stored["gray"]
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        return None
    return gray if gray.shape == (texels, texels) and gray.dtype == np.uint8 else None
