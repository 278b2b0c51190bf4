"""What the detector node hears of publishers that offer another quality of service."""

from __future__ import annotations

from processes import joint
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from hunt_ros.nodes.hunting_detector import HuntingDetectorNode


def test_a_driver_with_the_profile_of_sensor_data_is_heard_if_told_so_and_named_if_not(
    graph, resident
) -> None:
    health = graph.told()
    publishers = [
        graph.node.create_publisher(JointState, channel, qos_profile_sensor_data)
        for channel in ('lateral', 'yaw')
    ]
    node = resident(
        HuntingDetectorNode,
        **{'qos_overrides./rig/lateral.subscription.reliability': 'best_effort'},
    )
    node.trigger_configure()
    node.trigger_activate()
    sent = 0

    def told() -> dict[str, str]:
        nonlocal sent
        sent += 1
        for publisher, name in zip(publishers, ('lateral', 'yaw'), strict=True):
            publisher.publish(joint(name, 1_000_000_000 + sent * 10_000_000, 1e-6 * sent))
        return health.last

    graph.spin_until(lambda: int(told().get('received', 0)) > 0)
    graph.spin_until(lambda: '/rig/yaw is published with best effort' in told()['message'])
    text = told()['message']
    assert 'qos_overrides./rig/yaw.subscription.reliability' in text
    assert '/rig/lateral is published' not in text
    # As of a killed node and the one that was started in its place.
    second = graph.node.create_publisher(JointState, 'lateral', qos_profile_sensor_data)
    other = graph.beside('other')
    other.create_publisher(JointState, 'lateral', qos_profile_sensor_data)
    graph.spin_until(lambda: '/rig/lateral has 2 publishers' in told()['message'])
    assert '/rig/other' in told()['message']
    assert told()['level'] != 'OK'
    other.destroy_node()
    graph.node.destroy_publisher(second)
