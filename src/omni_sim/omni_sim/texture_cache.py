"""Keeps generated ground textures on disk, so that only the first run waits for them."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import tempfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omni_platform.configuration import to_mapping
from omni_sim.ground_texture import (
    GENERATION,
    GroundTexture,
    TextureConfiguration,
    generate_texture,
)

_CHECKSUM_BYTES = 4


class TextureCache:
    """Textures in a folder, one file each, named after everything that they depend on.

    A file is an array in numpy's format followed by its CRC-32. One that is missing, damaged or
    of the wrong shape is made anew. Writing is atomic, so processes may share the folder. The
    cache only saves time: where it cannot be written, textures are generated every time.

    Attributes:
        directory: the folder; it is made when the first texture is stored.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    @classmethod
    def of_user(cls) -> TextureCache:
        """Return the cache in the user's cache folder (``XDG_CACHE_HOME`` or ``~/.cache``)."""
        base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
        return cls(Path(base).expanduser() / "omni_sim" / "textures")

    def texture(self, configuration: TextureConfiguration) -> GroundTexture:
        """Return a texture, from the cache if it is there."""
        path = self.path(configuration)
        grey = _read(path, configuration.texels)
        if grey is not None:
            return GroundTexture(grey, configuration.size)
        texture = generate_texture(configuration)
        with contextlib.suppress(OSError):
            _write(path, texture.grey)
        return texture

    def path(self, configuration: TextureConfiguration) -> Path:
        """Return where a texture is kept."""
        identity = json.dumps([GENERATION, to_mapping(configuration)], sort_keys=True)
        digest = hashlib.sha256(identity.encode()).hexdigest()[:16]
        return self.directory / f"{configuration.kind}-{configuration.texels}-{digest}.texture"


def _read(path: Path, texels: int) -> NDArray[np.uint8] | None:
    """Return the texture in a file, or None if there is no sound one."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    body, checksum = content[:-_CHECKSUM_BYTES], content[-_CHECKSUM_BYTES:]
    if zlib.crc32(body).to_bytes(_CHECKSUM_BYTES, "little") != checksum:
        return None
    try:
        grey = np.load(io.BytesIO(body), allow_pickle=False)
    except (ValueError, EOFError, OSError):
        return None
    if not isinstance(grey, np.ndarray) or grey.dtype != np.uint8 or grey.shape != (texels, texels):
        return None
    return grey


def _write(path: Path, grey: NDArray[np.uint8]) -> None:
    buffer = io.BytesIO()
    np.save(buffer, grey, allow_pickle=False)
    body = buffer.getvalue()
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=path.name, suffix=".part", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(body)
            file.write(zlib.crc32(body).to_bytes(_CHECKSUM_BYTES, "little"))
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise
