"""The node that publishes the yaw angle psi, rad."""

from __future__ import annotations

import sys

from hunt_ros.nodes.runtime import run
from hunt_ros.nodes.sensor import SensorNode


def main() -> int:
    """Run the node."""
    return run(lambda: SensorNode('yaw'))


if __name__ == '__main__':
    sys.exit(main())
