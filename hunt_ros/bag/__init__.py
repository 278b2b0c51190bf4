"""
Recordings: columns in, messages out, repair, import and export.

Reading goes from `reader` (a recording) to the files of it (`mcap`, `sqlite_file`),
which hands out `blocks`; `columns` and `messages` take numbers and texts out of these through
`cdr`. Writing goes from `record_writer` (a whole record) and `recording` (a live one) to
`bag_writer` (a folder) and `mcap.writer` (a file). `interchange` reads and writes what is no bag.
"""

from hunt_ros.bag.bag_writer import BagWriter
from hunt_ros.bag.channels import ChannelSource, channel_map
from hunt_ros.bag.columns import read_columns, read_record
from hunt_ros.bag.plausible import check_units
from hunt_ros.bag.reader import Bag
from hunt_ros.bag.record_writer import write_record

__all__ = [
    'Bag',
    'BagWriter',
    'ChannelSource',
    'channel_map',
    'check_units',
    'read_columns',
    'read_record',
    'write_record',
]
