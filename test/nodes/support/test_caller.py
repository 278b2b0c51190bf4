"""What an operator asks for is done once the node is found; where nobody is, it says so."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy', reason='the extra ros is not installed')

import rclpy
from std_srvs.srv import Trigger

from hunt_ros.nodes.support.caller import Caller

pytestmark = pytest.mark.ros


@pytest.fixture
def node(domain):
    rclpy.init()
    made = rclpy.create_node('page')
    yield made
    made.destroy_node()
    rclpy.shutdown()


@pytest.fixture
def caller(node):
    made = Caller(node, lambda task, error: pytest.fail(f'{task}: {error}'))
    yield made
    made.close()


def answer(node, asked, machine):
    """Return what a call came to."""
    deadline = machine.deadline(30.0)
    while not asked.done():
        assert not deadline.passed
        rclpy.spin_once(node, timeout_sec=0.05)
    return asked.result()


def test_a_node_that_has_just_started_is_waited_for(node, caller, machine) -> None:
    asked = caller.call('mark')
    assert not asked.done()

    def mark(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Do it."""
        response.success, response.message = True, 'marked'
        return response

    node.create_service(Trigger, 'recording/mark', mark)
    assert answer(node, asked, machine) == (True, 'marked', True)


def test_where_nobody_offers_it_the_answer_says_so(node, caller, machine) -> None:
    asked = caller.call('emergency-stop')
    said = answer(node, asked, machine)
    assert (said.success, said.heard) == (False, False)
    # What a test before left behind may still be known, under another namespace.
    nobody = 'roller_speed is not running: nobody offers /speed/emergency_stop'
    assert said.message.partition(';')[0] == nobody
