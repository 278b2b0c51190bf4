"""
Where the messages of a chunk are: by its index where that fits, else record by record.

Functions on bytes; what does not fit raises `ValueError`.
"""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray

from hunt_ros.bag.blocks import Places, strided
from hunt_ros.bag.mcap import records as rec
from hunt_ros.bag.mcap.walk import ENTRY_BYTES, IndexPlace


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
    last = data.size - rec.MESSAGE_PREFIX
    if last < 0 or int(offsets.max()) > last:
        return None
    places = offsets.astype(np.int64)
    # Opcode and the low bytes of the length; the rest of it, and the channel.
    head = strided(data, '<u8', 0)[places]
    rest = strided(data, '<u4', 8)[places]
    lengths = (head >> np.uint64(8)).view(np.int64) - rec.MESSAGE_HEAD.size
    starts = places + rec.MESSAGE_PREFIX
    log_ns = strided(data, '<u8', 15)[places]
    sound = (
        ((head & np.uint64(0xFF)) == rec.MESSAGE).all()
        and ((rest & np.uint32(0xFFFFFF)) == channel << 8).all()
        and (lengths >= 0).all()
        and (lengths <= data.size - starts).all()
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
    rows: dict[int, array[int]] = {}
    for channel, log_ns, offset, length in rec.message_records(data.data):
        if channel in wanted:
            place = log_ns, offset + rec.MESSAGE_PREFIX, length - rec.MESSAGE_HEAD.size
            rows.setdefault(channel, array('Q')).extend(place)
    return {
        key: Places(*np.frombuffer(several, dtype=np.int64).reshape(-1, 3).T.copy())
        for key, several in rows.items()
    }
