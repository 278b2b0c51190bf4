"""There are few settings, and each says what it is."""

from __future__ import annotations

from dataclasses import fields

from hunt_ros.detection import DetectorConfig

#: More than a person who sets up a rig reads.
MOST = 25


def test_there_are_few_settings() -> None:
    assert len(fields(DetectorConfig)) <= MOST


def test_each_setting_says_what_it_is() -> None:
    for item in fields(DetectorConfig):
        assert item.metadata['description'], item.name
        if isinstance(item.default, float):
            assert item.metadata['low'] is not None, item.name
