"""Unpacking of the chunks of MCAP files with bounded memory."""

import zlib
from collections.abc import Callable
from typing import Any

from omni_recording.error import McapError
from omni_recording.limits import LIMITS


def unpacked(chunk: Any) -> bytes:
    """Return the unpacked records of a chunk.

    Raises:
        McapError: the chunk is damaged, is too large, or has an unknown compression.
    """
    size = chunk.uncompressed_size
    if size > LIMITS.record:
        raise McapError(
            f"has a chunk of {size} unpacked bytes, more than the limit of {LIMITS.record}"
        )
    unpack = _UNPACKERS.get(chunk.compression)
    if unpack is None:
        raise McapError(f"has chunks of an unknown compression ({chunk.compression[:20]!r})")
    try:
        raw = unpack(chunk.data, size)
    except (RuntimeError, ValueError, EOFError, MemoryError) as error:
        raise McapError(f"is damaged: a chunk cannot be unpacked ({error})") from None
    if len(raw) != size:
        raise McapError(f"is damaged: a chunk does not unpack to its {size} bytes")
    if chunk.uncompressed_crc and zlib.crc32(raw) != chunk.uncompressed_crc:
        raise McapError("is damaged: the checksum of a chunk is wrong")
    return raw


def _unpack_zstd(data: bytes, size: int) -> bytes:
    import zstandard

    try:
        # Reading one byte more than stated shows whether the chunk is longer.
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            return reader.read(size + 1)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from None


def _unpack_lz4(data: bytes, size: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    raw: bytes = LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    return raw


_UNPACKERS: dict[str, Callable[[bytes, int], bytes]] = {
    "": lambda data, _size: data,
    "zstd": _unpack_zstd,
    "lz4": _unpack_lz4,
}
