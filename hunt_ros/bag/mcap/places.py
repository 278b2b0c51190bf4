"""
Where the messages of a chunk are: by its index where that fits, else record by record.

Functions on bytes; what does not fit raises `ValueError`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.blocks import Places, strided
from hunt_ros.bag.mcap import format as fmt
from hunt_ros.bag.mcap.walk import ENTRY_BYTES, IndexPlace, records


def indexed_chunk(
    data: NDArray[np.uint8],
    index: dict[int, IndexPlace],
    whole: NDArray[np.uint8],
    wanted: set[int],
) -> dict[int, Places] | None:
    """
    Find the messages of a chunk by its index.

    Parameters
    ----------
    data : ndarray of uint8
        The expanded chunk.
    index : dict
        Where its indexes stand in the file.
    whole : ndarray of uint8
        The file.
    wanted : set of int
        Topic ids.

    Returns
    -------
    dict of int to Places, or None
        None where the index does not fit the chunk.
    """
    found = {}
    for channel in wanted & index.keys():
        offset, count = index[channel]
        entries = whole[offset : offset + count * ENTRY_BYTES].view('<u8')
        places = indexed_places(data, entries[1::2], channel)
        if places is None:
            return None
        found[channel] = places
    return found


def indexed_places(
    data: NDArray[np.uint8], offsets: NDArray[np.uint64], channel: int
) -> Places | None:
    """
    Check that there is a message of the channel at every offset, and where it ends.

    Returns
    -------
    Places or None
        None where the index does not fit the chunk.
    """
    if offsets.size == 0:
        return Places(*(np.zeros(0, np.int64) for _ in range(3)))
    last = data.size - fmt.MESSAGE_PREFIX
    if last < 0 or int(offsets.max()) > last:
        return None
    places = offsets.astype(np.int64)
    # Opcode and the low bytes of the length; the rest of it, and the channel.
    head = strided(data, '<u8', 0)[places]
    rest = strided(data, '<u4', 8)[places]
    lengths = (head >> np.uint64(8)).view(np.int64) - fmt.MESSAGE_HEAD.size
    starts = places + fmt.MESSAGE_PREFIX
    log_ns = strided(data, '<u8', 15)[places]
    sound = (
        ((head & np.uint64(0xFF)) == fmt.MESSAGE).all()
        and ((rest & np.uint32(0xFFFFFF)) == channel << 8).all()
        and (lengths >= 0).all()
        and (lengths <= data.size - starts).all()
        and int(log_ns.max()) < 1 << 63
    )
    return Places(log_ns.view(np.int64), starts, lengths) if sound else None


def walked_places(data: NDArray[np.uint8], wanted: set[int]) -> dict[int, Places]:
    """
    Walk a chunk record by record.

    Raises
    ------
    ValueError
        If it is no sequence of records.
    """
    raw = memoryview(data.data)
    rows: dict[int, list[tuple[int, int, int]]] = {}
    for opcode, offset, length in records(raw, 0, len(raw)):
        if opcode != fmt.MESSAGE:
            continue
        if length < fmt.MESSAGE_HEAD.size:
            raise ValueError(f'the message at byte {offset} of the chunk has no head')
        channel, _, log_ns, _ = fmt.MESSAGE_HEAD.unpack_from(raw, offset + 9)
        if log_ns >= 1 << 63:
            raise ValueError(f'the message at byte {offset} of the chunk has an impossible time')
        if channel in wanted:
            place = (log_ns, offset + fmt.MESSAGE_PREFIX, length - fmt.MESSAGE_HEAD.size)
            rows.setdefault(channel, []).append(place)
    return {
        key: Places(*(np.array(part, dtype=np.int64) for part in zip(*several, strict=True)))
        for key, several in rows.items()
    }
