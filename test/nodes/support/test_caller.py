"""What an operator asks for is done once the node is found; where nobody is, it says so."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy', reason='the extra ros is not installed')

import rclpy
from std_srvs.srv import Trigger

from hunt_ros.nodes.support.caller import Caller
from hunt_ros.services import SERVICES

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


def done(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
    response.success, response.message = True, 'done'
    return response


def test_a_node_that_has_just_started_is_waited_for(node, caller, machine) -> None:
    asked = caller.call('mark')
    assert not asked.done()

    node.create_service(Trigger, 'recording/mark', done)
    assert answer(node, asked, machine) == (True, 'done', True)


def test_a_key_that_is_held_down_delays_no_stop(node, caller, machine) -> None:
    caller._found_s = 60.0
    marks = [caller.call('mark') for _ in range(2 * len(SERVICES))]  # which nobody offers
    node.create_service(Trigger, 'speed/emergency_stop', done)
    assert answer(node, caller.call('emergency-stop'), machine).success
    assert not marks[0].done(), 'it did not wait for them'
    assert caller.call('no such word').result().heard is False


def test_where_nobody_offers_it_the_answer_says_so(node, caller, machine) -> None:
    asked = caller.call('emergency-stop')
    said = answer(node, asked, machine)
    assert (said.success, said.heard) == (False, False)
    # What a test before left behind may still be known, under another namespace.
    nobody = 'roller_speed is not running: nobody offers /speed/emergency_stop'
    assert said.message.partition(';')[0] == nobody
