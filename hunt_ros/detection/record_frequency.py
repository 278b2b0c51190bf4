"""
The hunting frequency from a whole record, where nobody has said it and it is not the usual one.

Only offline: a live detector cannot know what is to come. It names such motion instead
(`motion_outside_range`).
"""

from __future__ import annotations

import math
from dataclasses import replace

from hunt_ros.detection.configuration import DetectorConfig, with_frequencies
from hunt_ros.detection.estimates import shafts
from hunt_ros.estimation.record_lines import RecordLines, motion_of, turns_per_metre
from hunt_ros.samples import Record


def frequency_for(
    record: Record, config: DetectorConfig, known: bool = False
) -> tuple[DetectorConfig, list[str]]:
    """
    Take the nominal frequency from a record whose hunting is not in the usual range.

    Parameters
    ----------
    record : Record
        All of it decides.
    config : DetectorConfig
        Left as it is where it names a hunting frequency.
    known : bool
        True where something else tells the frequency, as a normal form does.

    Returns
    -------
    config : DetectorConfig
        With the frequency that was found outside the range, or unchanged.
    remarks : list of str
        One line where it was changed, and one for each forced line that is not a known one.
    """
    lines = RecordLines([motion_of(record)])
    turns = turns_per_metre(record, config.roller_diameter_m)
    orders = [order for shaft in shafts(config) for order in shaft.orders]
    named = [order * turns for order in orders if math.isfinite(turns)]
    remarks = [line.words(turns) for line in lines.forced(named)]
    if (
        known
        or config.hunting_frequency_hz
        or config.hunting_frequency_min_hz
        or config.hunting_frequency_max_hz
    ):
        return config, remarks
    usual = with_frequencies(config)
    low, high = usual.hunting_frequency_min_hz, usual.hunting_frequency_max_hz
    found = lines.hunting_hz
    if found is None or low <= found <= high:
        return config, remarks
    remark = (
        f'the motion whose amplitude changes most is at {found:.3g} Hz, outside the hunting'
        f' frequencies {low:.3g} to {high:.3g} Hz: it is taken for the hunting'
        ' (set hunting_frequency_hz if it is not)'
    )
    return replace(config, hunting_frequency_hz=found), [remark, *remarks]
