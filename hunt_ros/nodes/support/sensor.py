"""
A sensor node: publishes what its driver reads, stamped where the sample was taken.

`lateral_sensor`, `yaw_sensor` and `axle_box_sensor` are this node with another joint name.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hunt_ros.drivers.base import SensorBlock, SensorDriver
from hunt_ros.drivers.calibration import Calibration
from hunt_ros.nodes.support.conversions import joint_writer
from hunt_ros.nodes.support.diagnostics import Health, NewSince
from hunt_ros.nodes.support.driver_node import DriverNode
from hunt_ros.nodes.support.parameters import declare
from hunt_ros.nodes.support.qos import announce
from hunt_ros.samples import NANOSECONDS
from hunt_ros.settings import Settings, setting
from hunt_ros.suite import Awaited

#: The rate is away by more than this fraction of what is expected.
_RATE = 0.05


@dataclass(frozen=True)
class SensorConfig(Settings):
    """Parameters of a sensor node."""

    driver: str = setting(
        'simulated',
        'Where the samples come from, docs/drivers.md; its settings are parameters too.',
    )
    sample_rate_hz: float = setting(
        500.0,
        'Expected rate: WARN when it is missed by 5 %, STALE when nothing comes.',
        unit='Hz',
        low=10.0,  # the detector calls a channel silent after 0.3 s
        high=2000.0,
    )


class SensorNode(DriverNode[SensorDriver]):
    """
    Publishes one measured quantity as a JointState.

    Parameters
    ----------
    channel : str
        'lateral' (m), 'yaw' (rad) or 'axle_box' (m/s2): topic and joint name.
    """

    def __init__(self, channel: str) -> None:
        super().__init__(f'{channel}_sensor')
        self._config, given = declare(self, SensorConfig), declare(self, Calibration)
        driver = self._use_driver(
            self._config.driver, 'Sensor', channel, self._config.sample_rate_hz
        )
        self._calibration = given.within(*driver.range)
        self._written = joint_writer([channel])
        self._published = self._lost = self._bad = self._saturated = 0
        self._progress = 0, 0  # published, and the last stamp; set by the driver's thread at once
        self._told_ns = 0  # the last stamp of the last report
        self._new = NewSince()
        self._announced = announce(self, channel)

    def _take(self, block: SensorBlock) -> None:
        """Calibrate a block, and publish it."""
        calibration = self._calibration
        values = calibration.apply(block.values)
        self._saturated += int(np.count_nonzero(calibration.saturated(block.values)))
        self._lost += block.lost
        self._bad += int(np.count_nonzero(np.isnan(values)))
        for stamp_ns, value in zip(block.stamps_ns.tolist(), values.tolist(), strict=True):
            self._announced.publish(self._written(stamp_ns, value))
        self._published += block.values.size
        self._progress = self._published, int(block.stamps_ns[-1])

    def _lose(self, count: int) -> None:
        self._lost += count

    def _health(self) -> Health:
        """Say what came since the last report; the detector judges the channel itself."""
        published, newest_ns = self._progress
        count = self._new('published', published)
        passed_s = (newest_ns - self._told_ns) / NANOSECONDS if self._told_ns else math.nan
        self._told_ns = newest_ns
        expected_hz, rate_hz = self._config.sample_rate_hz, count / (passed_s or math.nan)
        lost = self._new('lost', self._lost)
        bad, saturated = self._new('bad', self._bad), self._new('saturated', self._saturated)
        values = {
            'rate_hz': round(rate_hz, 1),
            'published': self._published,
            'lost': self._lost,
            'bad': self._bad,
            'saturated': self._saturated,
        }
        if link := self._link():
            return *link, values
        said = [f'{lost} samples lost'] if lost else []
        if not count:
            level = 'STALE' if self._published else Awaited('STALE')
            return level, ', '.join(['no samples', *said]), values
        if saturated:
            said.append(f'{saturated} samples saturated')
        if bad > saturated:
            said.append(f'{bad - saturated} samples are no number')
        if abs(rate_hz / expected_hz - 1.0) > _RATE:
            said.append(f'{rate_hz:.0f} samples/s, expected {expected_hz:.0f}')
        if bad >= count:
            return 'STALE', '; '.join(['no valid sample', *said]), values
        if said:
            return 'WARN', '; '.join(said), values
        return 'OK', f'{rate_hz:.0f} samples/s', values
