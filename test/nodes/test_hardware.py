"""Nodes on hardware that goes away and comes back."""

from __future__ import annotations

import math

import pytest
from geometry_msgs.msg import TwistStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray

from hunt_ros.errors import ConfigError, DriverError
from hunt_ros.nodes.topic_driver import Sensor, Topic


def test_readings_become_si_and_a_device_that_is_cut_is_heard_again(graph, modbus_server) -> None:
    health = graph.told()
    heard = graph.collect(JointState, 'axle_box')
    modbus_server.put(3, 3)
    graph.start(
        'axle_box_sensor',
        driver='modbus',
        port=modbus_server.port,
        register=3,
        gain=0.002,
        offset=0.5,
        range=[-9.0, 9.0],
        sample_rate_hz=20.0,  # a slow bus
    )
    graph.spin_until(lambda: heard)
    assert heard[0].name == ['axle_box']
    assert heard[0].position[0] == 0.506
    modbus_server.put(3, -9)
    graph.spin_until(lambda: math.isnan(heard[-1].position[0]))
    graph.spin_until(lambda: health.says('no valid sample; ', level='STALE'))
    assert health.says('saturated')
    assert float(health.last['rate_hz']) > 0.0

    modbus_server.stop()
    words = f'modbus tcp 127.0.0.1:{modbus_server.port} device 1: cannot connect'
    graph.spin_until(lambda: health.says(level='ERROR', message=words))
    modbus_server.put(3, 8)
    modbus_server.start()
    graph.spin_until(lambda: heard[-1].position[0] == 0.516)
    health.clear()
    graph.spin_until(lambda: any(one['level'] != 'ERROR' for one in health))
    log = graph.log('axle_box_sensor').read_text()
    assert 'Connection to' not in log, 'the library does not write beside our one line'


def test_a_port_that_is_not_there_is_an_error_from_the_first_word_on(graph) -> None:
    pytest.importorskip('serial', reason='the extra serial is not installed')
    health = graph.told()
    graph.start('lateral_sensor', driver='serial_line', serial_port='/dev/no_such_port')
    words = 'serial line /dev/no_such_port at 115200 baud: cannot open it'
    graph.spin_until(lambda: health.says(words))
    assert {one['level'] for one in health if words in one['message']} == {'ERROR'}


def test_a_sensor_takes_what_another_node_already_publishes(graph) -> None:
    """Fields by the mapping of --channel, with the stamps of their header; no code needed."""
    heard = graph.collect(JointState, 'lateral')
    health = graph.told()
    source = '/daq/imu.linear_acceleration.y*0.5+1'
    graph.start('lateral_sensor', driver='topic', source=source)
    graph.spin_until(lambda: health.says('nobody publishes /daq/imu'))
    # As drivers of sensors publish: best effort.
    publisher = graph.node.create_publisher(Imu, '/daq/imu', qos_profile_sensor_data)
    message = Imu()
    message.linear_acceleration.y = 3.0
    message.header.stamp.sec = 1_700_000_000

    def heard_it() -> bool:
        message.header.stamp.nanosec += 1000
        publisher.publish(message)
        return len(heard) > 20

    graph.spin_until(heard_it)
    assert {each.position[0] for each in heard} == {2.5}
    assert {each.header.stamp.sec for each in heard} == {1_700_000_000}
    nanoseconds = [each.header.stamp.nanosec for each in heard]
    assert nanoseconds == sorted(set(nanoseconds))
    assert graph.end('lateral_sensor') == 0


def test_a_field_that_is_not_there_is_one_line(graph) -> None:
    publisher = graph.node.create_publisher(Float64MultiArray, '/daq/ch0', 10)
    sensor = Sensor(Topic(source='/daq/ch0.data[3]*0.001'), 'yaw', 500.0)
    sensor.open()
    got = []

    def read() -> bool:
        publisher.publish(Float64MultiArray(data=[0.0, 1.0, 2.0, 7.0]))
        got.extend(sensor.read(0.05).values)
        return bool(got)

    graph.spin_until(read)
    assert got[0] == 7.0e-3
    publisher.publish(Float64MultiArray(data=[0.0]))
    with pytest.raises(DriverError, match=r'topic /daq/ch0\.data\[3\]: Float64MultiArray'):
        graph.spin_until(lambda: sensor.read(0.05) is None)
    sensor.close()
    for source in ('data', '3.5', ''):
        with pytest.raises(ConfigError, match='names no topic'):
            Sensor(Topic(source=source), 'yaw', 500.0)


def test_a_modbus_drive_that_is_cut_gets_its_emergency_stop_when_it_is_back(
    graph, modbus_server
) -> None:
    """A drive without an encoder: its actual speed is the speed, and there is no roller."""
    health = graph.told()
    speeds = graph.collect(TwistStamped, 'speed')
    rollers = graph.collect(JointState, 'roller')
    modbus_server.put(50, 650)
    graph.start(
        'roller_speed', driver='modbus', port=modbus_server.port, speed_register=40,
        actual_register=50,
    )  # fmt: skip
    graph.spin_until(lambda: speeds)
    assert speeds[0].twist.linear.x == 6.5
    modbus_server.stop()
    graph.spin_until(lambda: health.says('cannot connect'))
    written = len(modbus_server.written)
    answer = graph.call('speed/emergency_stop')
    assert not answer.success
    assert 'modbus tcp' in answer.message
    modbus_server.start()
    graph.spin_until(lambda: len(modbus_server.written) > written)
    assert modbus_server.written[-1] == (40, [0])
    assert not rollers
