"""The node that publishes the lateral acceleration of the axle box, m/s2."""

from __future__ import annotations

from functools import partial

from hunt_ros.nodes.support.sensor import SensorNode

make_node = partial(SensorNode, 'axle_box')
