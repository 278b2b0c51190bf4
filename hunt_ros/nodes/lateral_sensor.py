"""The node that publishes the lateral displacement y, m."""

from __future__ import annotations

from functools import partial

from hunt_ros.nodes.support.sensor import SensorNode

make_node = partial(SensorNode, 'lateral')
