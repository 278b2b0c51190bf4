"""The node that publishes the yaw angle psi, rad."""

from __future__ import annotations

from functools import partial

from hunt_ros.nodes.support.sensor import SensorNode

make_node = partial(SensorNode, 'yaw')
