"""Polled subscriptions: however much comes, the executor has nothing to do with it."""

from __future__ import annotations

import json

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from hunt_ros.nodes.support import hearing
from hunt_ros.nodes.support.hearing import Calls, Missed, Said, waiting
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.qos import stream
from hunt_ros.nodes.support.runtime import cheapest_executor
from hunt_ros.suite import AGAIN

_MANY = 500


class Listener(SuiteNode):
    """One polled subscription, and one for the executor."""

    def __init__(self, context) -> None:
        super().__init__('listener', context=context)
        self.heard: list[str] = []
        self.many = self.create_polled_subscription(String, 'many', stream(2 * _MANY))
        self.create_subscription(String, 'one', lambda m: self.heard.append(m.data), stream(10))


@pytest.fixture
def listener(graph):
    node = Listener(graph.node.context)
    yield node
    node.destroy_node()


def _turns_until_heard(graph, executor, publisher, listener: Listener) -> int:
    listener.heard.clear()
    publisher.publish(String(data='now'))
    deadline = graph.machine.deadline(30.0)
    turns = 0
    while not listener.heard:
        assert not deadline.passed
        executor.spin_once(timeout_sec=0.1)
        turns += 1
    return turns


def test_what_the_executor_hears_does_not_wait_behind_a_flood(graph, listener) -> None:
    many = graph.beside('flood').create_publisher(String, '/many', stream(2 * _MANY))
    one = graph.node.create_publisher(String, '/one', stream(10))
    executor = cheapest_executor(listener.context)
    executor.add_node(listener)
    graph.spin_until(lambda: many.get_subscription_count() and one.get_subscription_count())
    _turns_until_heard(graph, executor, one, listener)  # from now on the executor has events
    for number in range(_MANY):
        many.publish(String(data=str(number)))
    texts: list[str] = []

    def all_have_come() -> bool:
        texts.extend(message.data for message, _ in waiting(listener.many))
        return len(texts) == _MANY

    graph.spin_until(all_have_come)
    assert texts == [str(number) for number in range(_MANY)]
    assert not list(waiting(listener.many))
    assert _turns_until_heard(graph, executor, one, listener) < _MANY / 10
    executor.shutdown()


def test_a_full_reader_keeps_the_newest_and_what_is_lost_is_counted(graph, listener) -> None:
    many = graph.beside('flood').create_publisher(String, '/many', stream(4 * _MANY))
    graph.spin_until(many.get_subscription_count)
    missed, numbers = Missed(listener, '/many'), []

    def has_come(last: int) -> bool:
        for message, info in waiting(listener.many):
            missed.take(info)
            numbers.append(int(message.data))
        return numbers[-1:] == [last]

    many.publish(String(data='0'))
    graph.spin_until(lambda: has_come(0))
    for number in range(1, 4 * _MANY):
        many.publish(String(data=str(number)))
    graph.spin_until(lambda: has_come(4 * _MANY - 1))
    assert numbers == sorted(set(numbers))
    assert missed.count == 4 * _MANY - len(numbers) > 0


def test_a_node_that_is_started_again_waits_for_no_sensor_beside_one(graph, monkeypatch) -> None:
    """Gauntlet 761: it was blind for 10 s, of which 5 s for a sensor that it found late."""
    monkeypatch.setattr(hearing, '_TOGETHER_S', 1e9)
    monkeypatch.setenv(AGAIN, '1')
    node = SuiteNode('detector', alone=False, context=graph.node.context)
    channels = hearing.Channels(node, ['lateral', 'yaw'])
    lateral = graph.beside('sensor').create_publisher(JointState, '/lateral', stream(10))

    def begins() -> bool:
        lateral.publish(JointState(name=['lateral'], position=[0.0]))
        return channels.begun()

    graph.spin_until(begins)
    node.destroy_node()


def test_the_words_of_two_that_call_at_once_are_both_taken(graph, listener) -> None:
    calls = Calls(listener, {'mark': lambda said: said.words})
    said = graph.node.create_publisher(String, '/listener/calls', stream(10))
    graph.spin_until(said.get_subscription_count)
    for words in ('bump', 'joint'):
        said.publish(String(data=json.dumps({'service': 'mark', 'who': 'me', 'words': words})))
    taken: list[Said] = []

    def both() -> bool:
        taken.extend(each for each in [calls.take('mark')] if each.words)
        return len(taken) == 2

    graph.spin_until(both)
    assert {each.words for each in taken} == {'bump', 'joint'}
    assert calls.take('mark') == Said()
