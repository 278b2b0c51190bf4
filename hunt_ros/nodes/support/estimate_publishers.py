"""
The estimate topics: what they are called, what each field of them holds, and how often.

`ESTIMATES` is the one table: the publishers, the recorder (which leaves these topics out,
because a replay makes them again) and the README follow from it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from hunt_ros.nodes.support.conversions import FixedLayout, joint_layout
from hunt_ros.nodes.support.qos import stream
from hunt_ros.samples import NORMAL_95

#: A column of the detector's rows, what is made of one, or a name in `EstimatePublishers.beside`.
_Column = str | Callable[[np.ndarray], np.ndarray]

#: Topics are looked at this often for somebody who listens, s.
_LOOK_S = 0.2
#: Spacing of the slow topics, ns.
_SLOW_NS = 50_000_000


@dataclass(frozen=True)
class EstimateTopic:
    """
    One topic: a JointState that has the value in `position`.

    Parameters
    ----------
    name : str
        Relative name.
    joints : tuple of str
        Their names are never those of a measurement: a 3D view would move the wheelset by them.
    position, velocity, effort : tuple of columns
        Of each joint the value, its rate of change, its standard deviation; empty: not told.
    fast : bool
        Published with every row (parameter `output_rate_hz`); else 20 times a second.
    content : str
        What the fields hold, with units.
    """

    name: str
    joints: tuple[str, ...]
    position: tuple[_Column, ...]
    velocity: tuple[_Column, ...] = ()
    effort: tuple[_Column, ...] = ()
    fast: bool = False
    content: str = ''


def _angular_frequency(rows: np.ndarray) -> np.ndarray:
    """Return 2 pi f, rad/s."""
    return 2.0 * np.pi * rows['frequency_hz']


def _margin_std(rows: np.ndarray) -> np.ndarray:
    """Return the standard deviation that a normal 95 % interval of this width would have."""
    return (rows['margin_high'] - rows['margin_low']) / (2.0 * NORMAL_95)


_AMPLITUDES = ('lateral_amplitude', 'yaw_amplitude')
_ENVELOPES = ('lateral_envelope', 'yaw_envelope')
_ROUGHNESS = ('lateral_roughness', 'yaw_roughness')

ESTIMATES: tuple[EstimateTopic, ...] = (
    EstimateTopic(
        'hunting/amplitude',
        _AMPLITUDES,
        position=_AMPLITUDES,
        velocity=('lateral_amplitude_rate', 'yaw_amplitude_rate'),
        effort=('lateral_amplitude_std', 'yaw_amplitude_std'),
        fast=True,
        content='amplitude of the hunting component (m, rad); `velocity` its rate',
    ),
    EstimateTopic(
        'hunting/envelope',
        _ENVELOPES,
        position=_ENVELOPES,
        fast=True,
        content='Hilbert envelope, the second estimate of it (m, rad)',
    ),
    EstimateTopic(
        'hunting/phase',
        ('hunting_phase',),
        position=('phase',),
        velocity=(_angular_frequency,),
        effort=('phase_std',),
        fast=True,
        content='phase (rad); `velocity` the angular frequency (rad/s)',
    ),
    EstimateTopic(
        'hunting/roughness',
        _ROUGHNESS,
        position=_ROUGHNESS,
        effort=('lateral_roughness_std', 'yaw_roughness_std'),
        content='amplitude of the first known line (m, rad)',
    ),
    EstimateTopic(
        'hunting/growth_rate',
        ('growth_rate',),
        position=('growth_rate',),
        effort=('growth_rate_std',),
        content='growth rate of the amplitude (1/s)',
    ),
    EstimateTopic(
        'hunting/margin',
        ('margin',),
        position=('margin',),
        effort=(_margin_std,),
        content='unstable amplitude over amplitude (1)',
    ),
    EstimateTopic(
        'hunting/unstable_amplitude',
        ('unstable_amplitude',),
        position=('unstable_amplitude',),
        effort=('unstable_amplitude_std',),
        content='amplitude beyond which the motion grows (m)',
    ),
    EstimateTopic(
        'hunting/critical_speed',
        ('critical_speed',),
        position=('critical_speed',),
        effort=('critical_speed_std',),
        content='v_c of the normal form, of the parameters, or of the forecast (m/s)',
    ),
)


def readme_table() -> str:
    """Return the lines of the table of topics in the README."""
    lines = []
    for topic in ESTIMATES:
        often = '`output_rate_hz`' if topic.fast else f'{1e9 / _SLOW_NS:.0f} Hz'
        std = '; `effort` its standard deviation' if topic.effort else ''
        lines.append(
            f'| `{topic.name}` | sensor_msgs/JointState | {topic.content}{std}; {often} |'
        )
    return '\n'.join(lines)


@dataclass(frozen=True)
class _Output:
    """A topic that is published, and the bytes of its message."""

    topic: EstimateTopic
    publisher: Publisher
    layout: FixedLayout


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
    frame : str
        frame_id of the messages.

    Attributes
    ----------
    beside : dict of str to float
        What is published beside the columns of the rows: the owner keeps it up to date.
    """

    def __init__(self, node: Node, rate_hz: float, frame: str) -> None:
        qos = stream(int(rate_hz))
        self._outputs = [
            _Output(
                topic,
                node.create_publisher(JointState, topic.name, qos),
                joint_layout(topic.joints, frame, bool(topic.velocity), bool(topic.effort)),
            )
            for topic in ESTIMATES
        ]
        self._heard: list[_Output] = []
        self._look_at = 0.0
        self._slot = -1
        self.beside = {'critical_speed': np.nan, 'critical_speed_std': np.nan}

    def publish(self, rows: np.ndarray) -> None:
        """Publish rows of the detector's estimates (`ESTIMATE_DTYPE`), all or every so many."""
        now = time.monotonic()
        if now >= self._look_at:
            self._look_at = now + _LOOK_S
            self._heard = [out for out in self._outputs if out.publisher.get_subscription_count()]
        slots = rows['stamp_ns'] // _SLOW_NS
        slow = rows[np.diff(slots, prepend=self._slot) != 0]
        self._slot = slots[-1]
        for out in self._heard:
            self._write(out, rows if out.topic.fast else slow)

    def _write(self, out: _Output, rows: np.ndarray) -> None:
        topic = out.topic
        columns = (*topic.position, *topic.velocity, *topic.effort)
        values = [self._values(rows, column) for column in columns]
        for stamp_ns, *numbers in zip(rows['stamp_ns'].tolist(), *values, strict=True):
            out.publisher.publish(out.layout.encode(stamp_ns, *numbers))

    def _values(self, rows: np.ndarray, column: _Column) -> list[float]:
        if not isinstance(column, str):
            return column(rows).tolist()
        if column in self.beside:
            return [self.beside[column]] * len(rows)
        return rows[column].tolist()
