"""
Writing a whole record as a recording, and texts beside it.

`BagWriter` itself, for writing message by message, lives in `bag_writer`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hunt_ros.bag.bag_writer import BagWriter
from hunt_ros.bag.mcap.writer import CHUNK_BYTES
from hunt_ros.bag.record_rows import record_rows
from hunt_ros.errors import BagError
from hunt_ros.samples import Record

__all__ = ['BagWriter', 'absolute', 'write_record', 'write_texts']


def write_record(
    path: str | Path,
    record: Record,
    *,
    namespace: str = 'rig',
    notes: Mapping[str, str] | None = None,
    texts: Mapping[str, str] | None = None,
    compression: str = 'zstd',
    chunk_bytes: int = CHUNK_BYTES,
) -> Path:
    """
    Write a record as a recording with the topics of a live rig.

    The sensors of the motion and `roller` become sensor_msgs/JointState, `speed` becomes
    geometry_msgs/TwistStamped; log time and header stamp are the sample's stamp.

    Parameters
    ----------
    path : str or Path
        Folder to make.
    record : Record
        Samples as they are; NaN stays NaN.
    namespace : str
        Of the topics; '' for none.
    notes : mapping of str to str, optional
        Added to the record's own.
    texts : mapping of str to str, optional
        std_msgs/String messages by relative topic ('hunting/normal_form'), latched,
        at the first stamp.
    compression : str
        '', 'lz4' or 'zstd'.
    chunk_bytes : int
        About the size of a chunk before compression.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    BagError
        If the record is empty, a stamp is negative, or the folder cannot be written.
    """
    if not any(len(series) for series in record.values()):
        raise BagError(f'{path}: the record of {record.source or "no source"} has no samples')
    if record.start_ns < 0:
        raise BagError(f'{path}: a stamp of {record.start_ns} ns, expected none before 1970')
    together = {**record.notes, **(notes or {})}
    with BagWriter(path, notes=together, compression=compression) as bag:
        write_texts(bag, texts or {}, record.start_ns, namespace)
        for several in record_rows(record, bag.topic, namespace, chunk_bytes):
            bag.write_rows(several)
    return Path(path)


def write_texts(
    bag: BagWriter, texts: Mapping[str, str], stamp_ns: int, namespace: str = 'rig'
) -> None:
    """
    Write latched std_msgs/String messages, one a topic.

    Raises
    ------
    BagError
        If the disk refuses.
    """
    for name, text in texts.items():
        topic = bag.topic(absolute(namespace, name), 'std_msgs/msg/String', latched=True)
        raw = text.encode('utf-8')
        length = (len(raw) + 1).to_bytes(4, 'little')
        bag.write(topic, stamp_ns, b'\x00\x01\x00\x00' + length + raw + b'\x00')


def absolute(namespace: str, name: str) -> str:
    """Return a relative topic name under a namespace."""
    return '/' + '/'.join(part.strip('/') for part in (namespace, name) if part.strip('/'))
