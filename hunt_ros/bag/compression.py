"""
Compression of chunks, files and messages, with a bound on what it may expand to.

A damaged or hostile bag may claim any size: nothing is allocated before the claim
has been compared with what is there. The Reader of rosbags has no such bound: for one message of
98 kB it asks for 3 GiB.
"""

from __future__ import annotations

import lz4.frame
import zstandard

#: No chunk and no message may be larger than this when expanded (bytes).
LARGEST_CHUNK = 1 << 30


def is_compressed(data: bytes) -> bool:
    """Return True for what begins as a zstd frame (RFC 8878, 3.1.1), and so not as CDR."""
    return data[:4] == zstandard.FRAME_HEADER


def compress(data: bytes, compression: str) -> bytes:
    """Compress a chunk; '' leaves it as it is."""
    if compression == 'zstd':
        return zstandard.ZstdCompressor(level=1).compress(data)
    if compression == 'lz4':
        packed: bytes = lz4.frame.compress(data)
        return packed
    return data


def expand(data: bytes | memoryview, compression: str, size: int) -> bytes | memoryview:
    """
    Decompress a chunk that claims to hold `size` bytes.

    Raises
    ------
    ValueError
        If the compression is unknown, the claim is impossible, or it is not kept.
    """
    if size > LARGEST_CHUNK:
        raise ValueError(f'it claims to hold {size} bytes, at most {LARGEST_CHUNK} are accepted')
    if compression == '':
        expanded: bytes | memoryview = data
    elif compression == 'zstd':
        expanded = expand_zstd(data, size)
    elif compression == 'lz4':
        expanded = _expand_lz4(data, size)
    else:
        raise ValueError(f'compression {compression!r} is unknown, expected lz4 or zstd')
    if len(expanded) != size:
        raise ValueError(f'it claims to hold {size} bytes and holds {len(expanded)}')
    return expanded


def expand_zstd(data: bytes | memoryview, limit: int = LARGEST_CHUNK) -> bytes:
    """
    Decompress one zstd frame of at most `limit` bytes.

    Raises
    ------
    ValueError
        If it is not a zstd frame, or expands beyond the limit.
    """
    try:
        claimed = zstandard.frame_content_size(data)
        if claimed > limit:
            raise ValueError(f'a zstd frame claims {claimed} bytes, expected at most {limit}')
        # With an unknown content size (-1) the library needs the bound; 0 means none to it.
        bound = limit if claimed < 0 else claimed
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=max(bound, 1))
    except (zstandard.ZstdError, MemoryError) as error:
        raise ValueError(f'zstd cannot expand it ({error})') from error


def _expand_lz4(data: bytes | memoryview, size: int) -> bytes:
    try:
        machine = lz4.frame.LZ4FrameDecompressor()
        expanded: bytes = machine.decompress(bytes(data), max_length=size + 1)
        return expanded
    except (RuntimeError, MemoryError, EOFError, ValueError) as error:
        raise ValueError(f'lz4 cannot expand it ({error})') from error
