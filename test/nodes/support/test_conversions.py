"""Wire bytes written and read by layout are those of ROS itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from hunt_ros.bag.cdr.message_types import standard_types
from hunt_ros.dashboard.words import Words
from hunt_ros.detection import DetectorConfig, HuntingDetector
from hunt_ros.drivers.interlock import Interlock, InterlockSettings
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.profile import Climb, Seesaw
from hunt_ros.nodes.support import conversions
from hunt_ros.nodes.support.conversions import (
    ChannelReader,
    diagnostic,
    heard_of,
    joint_writer,
    read_diagnostic,
    to_ns,
    twist,
)
from hunt_ros.sensors import JOINT_STATE

stamps = st.integers(0, 2**31 * 10**9 - 1)
numbers = st.floats(allow_nan=False)


@given(stamp=stamps, values=st.tuples(numbers, numbers))
def test_a_written_joint_state_is_read_by_ros(stamp, values) -> None:
    wire = joint_writer(['lateral_amplitude', 'yaw_amplitude'])(stamp, *values)
    message = deserialize_message(wire, JointState)
    assert to_ns(message.header.stamp) == stamp
    assert message.header.frame_id == 'roller_rig'
    assert tuple(message.position) == values
    assert len(message.velocity) == len(message.effort) == 0


@pytest.mark.parametrize(('velocity', 'effort'), [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_a_written_joint_state_has_no_byte_too_many(velocity, effort) -> None:
    values = [float(value) for value in range(2 * (1 + velocity + effort))]
    wire = joint_writer(['a', 'b'], velocity, effort)(5, *values)
    standard_types().deserialize_cdr(wire, JOINT_STATE)  # refuses what is left over
    message = deserialize_message(wire, JointState)
    assert len(message.velocity) == 2 * velocity
    assert len(message.effort) == 2 * effort
    assert sorted([*message.position, *message.velocity, *message.effort]) == values


def test_a_joint_is_found_among_others_and_its_absence_is_noticed() -> None:
    message = JointState(name=['a', 'lateral'], position=[1.0, 2.0], velocity=[0.0], effort=[0.0])
    wire = serialize_message(message)
    assert ChannelReader('lateral').read(wire) == (0, 2.0)
    assert ChannelReader('yaw').read(wire) is None


def test_another_layout_in_between_is_read_too() -> None:
    reader = ChannelReader('lateral')
    first = joint_writer(['lateral'], velocity=True)(1, 0.5, 7.0)
    message = JointState(name=['lateral'], position=[0.75])
    message.header.stamp.nanosec, message.header.frame_id = 2, 'another_frame'
    other = serialize_message(message)
    assert [reader.read(wire) for wire in (first, other, first)] == [(1, 0.5), (2, 0.75), (1, 0.5)]


def test_bytes_without_meaning_between_the_fields_cost_no_message(monkeypatch) -> None:
    """Another process leaves others there, in each of its messages."""
    wire = bytearray(joint_writer(['lateral'])(1, 0.5))
    wire[27:28] = b'\xab'  # behind the eleven bytes of the frame
    reader = ChannelReader('lateral')
    assert reader.read(bytes(wire)) == (1, 0.5)
    monkeypatch.setattr(conversions, 'deserialize_message', None)
    assert reader.read(bytes(wire)) == (1, 0.5)


@given(cut=st.integers(0, 80), damage=st.binary(max_size=80))
def test_bytes_that_are_no_message_are_left_out_and_the_next_message_is_read(cut, damage) -> None:
    whole = joint_writer(['lateral'])(1, 0.5)
    for first in (whole, b''):
        reader = ChannelReader('lateral')
        reader.read(first)
        for wire in (damage, whole[:cut], whole[:cut] + damage):
            read = reader.read(wire)
            assert read is None or len(wire) >= len(whole) - 8
        assert reader.read(whole) == (1, 0.5)


def test_a_speed_is_read_from_the_wire() -> None:
    reader = ChannelReader('speed')
    for stamp, speed in ((5, 7.25), (2_000_000_005, -0.5)):
        assert reader.read(serialize_message(twist(stamp, speed))) == (stamp, speed)
    assert deserialize_message(serialize_message(twist(5, 7.25)), TwistStamped).twist.linear.x


def test_a_diagnostic_keeps_every_digit() -> None:
    values = {'amplitude_m': 1 / 3, 'bad': math.nan}
    array = diagnostic(3, 'rig/hunting', 'WARN', 'why', values, 'the rig')
    message = deserialize_message(serialize_message(array), DiagnosticArray)
    assert message.status[0].hardware_id == 'the rig'
    texts = read_diagnostic(message)
    assert (texts['level'], texts['message']) == ('WARN', 'why')
    assert float(texts['amplitude_m']) == 1 / 3
    assert math.isnan(float(texts['bad']))


def test_a_v_n_that_is_not_known_is_not_0() -> None:
    """Of the laws that are as likely too few have one: no speed is above it, none is below."""
    paper = IdentifiedNormalForm(PAPER_NORMAL_FORM)
    sample = np.tile(paper.vector, (64, 1))
    sample[:26, 5] = 0.0
    detector = HuntingDetector(DetectorConfig())
    detector.set_normal_form(replace(paper, covariance=np.diag([1e-4] * 6), sample=sample))
    values = {**detector.status.values, 'speed_mps': 7.0, 'held_s': 0.0}
    told = diagnostic(1, 'rig/hunting', 'OK', '', values, 'rig')
    heard = heard_of(told)
    assert heard.motion.v_c == 8.0
    interlock = Interlock(InterlockSettings(safe_speed_mps=5.5))
    interlock.hear(1, heard)
    assert interlock.safe_speed_mps() == 5.5
    assert interlock.unsafe() == ''
    assert Climb(6.0, 7.0).missing(heard.motion) == ''
    assert 'no normal form with v_n' in Seesaw(60.0).missing(heard.motion)
    tiles = {tile['key']: tile['text'] for tile in Words().tiles(read_diagnostic(told), {})}
    assert (tiles['to_v_n'], tiles['to_v_c']) == ('–', '+1.00')


def test_a_number_of_any_length_ends_no_guard() -> None:
    message = diagnostic(0, 'detector', 'OK', '', {'sequence': '9' * 5000}, 'rig')
    assert heard_of(message).sequence > 0
