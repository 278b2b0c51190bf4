"""
The estimate topics: what they are called, what each field of them holds, and how often.

`ESTIMATES` is the one table: the publishers and the recorder (which leaves these topics out,
because a replay makes them again) follow from it; docs/topics.md says what they hold.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from hunt_ros.nodes.support.conversions import joint_writer
from hunt_ros.nodes.support.qos import stream
from hunt_ros.samples import NORMAL_95

#: Topics are looked at this often for somebody who listens, s.
_LOOK_S = 0.2
#: Spacing of the slow topics, ns.
_SLOW_NS = 50_000_000


class EstimateTopic(NamedTuple):
    """
    One topic: a JointState that has the value in `position`.

    Parameters
    ----------
    name : str
        Relative name.
    joints : tuple of str
        Columns of the detector's rows, or of `_MADE`. They are never the names of a measurement: a
        3D view would move the wheelset by them.
    rate, std : bool
        Whether `velocity` has the rate of change, the column `..._rate`, and `effort` the standard
        deviation, the column `..._std`.
    fast : bool
        Published with every row (parameter `output_rate_hz`); else 20 times a second.
    """

    name: str
    joints: tuple[str, ...]
    rate: bool = False
    std: bool = True
    fast: bool = False

    @property
    def columns(self) -> list[str]:
        """Names of all that is published, in the order of the message."""
        endings = ('', *(['_rate'] if self.rate else []), *(['_std'] if self.std else []))
        return [f'{joint}{ending}' for ending in endings for joint in self.joints]


#: Columns that are made of others.
_MADE: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    'hunting_phase': lambda rows: rows['phase'],
    'hunting_phase_rate': lambda rows: 2.0 * np.pi * rows['frequency_hz'],
    'hunting_phase_std': lambda rows: rows['phase_std'],
    # That of a normal 95 % interval of this width.
    'margin_std': lambda rows: (rows['margin_high'] - rows['margin_low']) / (2.0 * NORMAL_95),
}

ESTIMATES = (
    EstimateTopic(
        'hunting/amplitude', ('lateral_amplitude', 'yaw_amplitude'), rate=True, fast=True
    ),
    EstimateTopic('hunting/envelope', ('lateral_envelope', 'yaw_envelope'), std=False, fast=True),
    EstimateTopic('hunting/phase', ('hunting_phase',), rate=True, fast=True),
    EstimateTopic('hunting/roughness', ('lateral_roughness', 'yaw_roughness')),
    EstimateTopic('hunting/growth_rate', ('growth_rate',)),
    EstimateTopic('hunting/margin', ('margin',)),
    EstimateTopic('hunting/unstable_amplitude', ('unstable_amplitude',)),
    EstimateTopic('hunting/critical_speed', ('critical_speed',)),
)


class EstimatePublishers:
    """
    Publishes rows of estimates on the topics of `ESTIMATES`, where somebody listens.

    Most of what the detector node costs is writing to the middleware; a topic that nobody
    has subscribed is left out. Who comes later hears it from `_LOOK_S` on at the latest.

    Parameters
    ----------
    node : Node
        Gets the publishers.
    rate_hz : float
        Rate of the rows: the topics keep one second of them.

    Attributes
    ----------
    beside : dict of str to float
        What is published beside the columns of the rows: the owner keeps it up to date.
    """

    def __init__(self, node: Node, rate_hz: float) -> None:
        qos = stream(int(rate_hz))
        self._outputs = [
            (
                topic,
                node.create_publisher(JointState, topic.name, qos),
                joint_writer(topic.joints, topic.rate, topic.std),
            )
            for topic in ESTIMATES
        ]
        self._heard = self._outputs[:0]
        self._look_at = 0.0
        self._slot = -1
        self.beside = {'critical_speed': np.nan, 'critical_speed_std': np.nan}

    def publish(self, rows: np.ndarray) -> None:
        """Publish rows of the detector's estimates (`ESTIMATE_DTYPE`), all or every so many."""
        now = time.monotonic()
        if now >= self._look_at:
            self._look_at = now + _LOOK_S
            self._heard = [each for each in self._outputs if each[1].get_subscription_count()]
        slots = rows['stamp_ns'] // _SLOW_NS
        slow = rows[np.diff(slots, prepend=self._slot) != 0]
        self._slot = slots[-1]
        for topic, publisher, written in self._heard:
            chosen = rows if topic.fast else slow
            values = [self._values(chosen, column) for column in topic.columns]
            for stamp_ns, *numbers in zip(chosen['stamp_ns'].tolist(), *values, strict=True):
                publisher.publish(written(stamp_ns, *numbers))

    def _values(self, rows: np.ndarray, column: str) -> list[float]:
        if column in self.beside:
            return [self.beside[column]] * len(rows)
        values = _MADE[column](rows) if column in _MADE else rows[column]
        return values.tolist()
