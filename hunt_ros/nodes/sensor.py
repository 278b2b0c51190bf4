"""
A sensor node: publishes what its driver reads, stamped where the sample was taken.

`lateral_sensor` and `yaw_sensor` are this node with another joint name.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from sensor_msgs.msg import JointState

from hunt_ros.drivers.base import SensorBlock
from hunt_ros.nodes.conversions import joint_layout
from hunt_ros.nodes.diagnostics import Diagnostics, Health, NewSince
from hunt_ros.nodes.driver_node import DriverNode
from hunt_ros.nodes.parameters import declare, warn_unknown
from hunt_ros.nodes.qos import stream
from hunt_ros.settings import Settings, setting


@dataclass(frozen=True)
class SensorConfig(Settings):
    """Parameters of a sensor node."""

    driver: str = setting(
        'simulated',
        'Where the samples come from, docs/drivers.md; its settings are parameters too.',
        fixed=True,
    )
    sample_rate_hz: float = setting(
        500.0,
        'Expected rate: WARN when it is missed by 5 %, STALE when nothing comes.',
        unit='Hz',
        low=100.0,
        high=2000.0,
        fixed=True,
    )
    frame_id: str = setting('roller_rig', 'frame_id of the messages.', fixed=True)
    autostart: bool = setting(True, 'Configure and activate without being told.', fixed=True)


class SensorNode(DriverNode):
    """
    Publishes one measured quantity as a JointState.

    Parameters
    ----------
    channel : str
        'lateral' (m) or 'yaw' (rad): topic and joint name.
    """

    def __init__(self, channel: str) -> None:
        super().__init__(f'{channel}_sensor')
        self._channel = channel
        self._config = declare(self, SensorConfig)
        hardware = self._use_driver(
            self._config.driver, 'Sensor', channel, self._config.sample_rate_hz
        )
        warn_unknown(self)
        depth = int(self._config.sample_rate_hz)
        self._announced = self.create_publisher(JointState, channel, stream(depth))
        self._layout = joint_layout([channel], self._config.frame_id)
        self._published = 0
        self._lost = 0
        self._bad = 0
        self._new = NewSince()
        self._reported_s = 0.0
        self._diagnostics = Diagnostics(self, self._health, hardware)

    def _take(self, block: SensorBlock, publish: bool) -> None:
        if not publish:
            return
        self._lost += block.lost
        self._bad += int(np.count_nonzero(np.isnan(block.values)))
        for stamp_ns, value in zip(block.stamps_ns.tolist(), block.values.tolist(), strict=True):
            self._announced.publish(self._layout.encode(stamp_ns, value))
        self._published += block.values.size

    def _lose(self, count: int) -> None:
        self._lost += count

    def _health(self) -> Health:
        now_s = time.monotonic()
        elapsed_s, self._reported_s = now_s - self._reported_s, now_s
        fresh = self._new('published', self._published)
        begun = fresh < self._published  # the first second is not a whole one
        rate = fresh / elapsed_s
        lost = self._new('lost', self._lost)
        values = {
            'rate_hz': round(rate, 1),
            'published': self._published,
            'lost': self._lost,
            'bad': self._bad,
        }
        if link := self._link():
            return *link, values
        if not self._active.is_set():
            return 'OK', 'inactive', values
        if not fresh:
            return 'STALE', f'no samples, {lost} samples lost' if lost else 'no samples', values
        if lost:
            return 'WARN', f'{lost} samples lost', values
        expected = self._config.sample_rate_hz
        simulated_time = self.get_parameter('use_sim_time').value
        if begun and not simulated_time and abs(rate / expected - 1.0) > 0.05:
            return 'WARN', f'{rate:.0f} samples/s, expected {expected:.0f}', values
        return 'OK', f'{rate:.0f} samples/s', values
