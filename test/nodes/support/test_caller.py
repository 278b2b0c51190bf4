"""What an operator asks for is done once the node is found; where nobody is, it says so."""

from __future__ import annotations

import pytest
import rclpy
from std_srvs.srv import Trigger

from hunt_ros.nodes.support.caller import Caller
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.services import SERVICES


@pytest.fixture
def node(domain):
    rclpy.init()
    made = SuiteNode('page', alone=False)
    yield made
    made.close()
    made.destroy_node()
    rclpy.shutdown()


@pytest.fixture
def caller(node):
    made = Caller(node)
    yield made
    made.close()
    assert not node._diagnostics._failures


def test_a_key_that_is_held_down_delays_no_stop(node, caller, machine) -> None:
    caller._found_s = 60.0
    marks = [caller.call('mark') for _ in range(2 * len(SERVICES))]  # which nobody offers
    node.create_service(
        Trigger, 'speed/emergency_stop', lambda _, given: Trigger.Response(success=True)
    )
    asked = caller.call('emergency-stop')

    def answered() -> bool:
        rclpy.spin_once(node, timeout_sec=0.05)
        return asked.done()

    machine.until(answered)
    assert asked.result().success
    assert not marks[0].done(), 'it did not wait for them'
    assert caller.call('no such word').result().heard is False
