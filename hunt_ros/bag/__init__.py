"""Recordings: columns in, messages out, repair, import and export."""

from hunt_ros.bag.channels import ChannelSource, channel_map, read_channel_file
from hunt_ros.bag.columns import read_columns, read_record
from hunt_ros.bag.plausible import check_units
from hunt_ros.bag.reader import Bag
from hunt_ros.bag.record_writer import BagWriter, write_record

__all__ = [
    'Bag',
    'BagWriter',
    'ChannelSource',
    'channel_map',
    'check_units',
    'read_channel_file',
    'read_columns',
    'read_record',
    'write_record',
]
