"""A node says at once what it is doing, and ends at a signal whatever it is doing."""

from __future__ import annotations

import signal

import pytest
from geometry_msgs.msg import TwistStamped

#: The promise, s, of a quick idle machine.
SAYS_S, ENDS_S = 2.0, 2.0


def text(graph, node: str) -> str:
    return graph.log(node).read_text()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_imports_says_so_and_ends_without_a_traceback(graph, number) -> None:
    graph.start('hunting_detector')
    graph.spin_until(lambda: text(graph, 'hunting_detector'), SAYS_S)
    assert graph.end('hunting_detector', number, ENDS_S) == 0
    lines = text(graph, 'hunting_detector').splitlines()
    assert lines[0] == 'hunting_detector: starting'
    # Where the import is over within the notice, the node ends by itself and has nothing to say.
    assert set(lines[1:]) <= {'hunting_detector: ended while starting'}


def test_a_node_that_waits_for_its_hardware_ends(graph) -> None:
    graph.start('roller_speed', port=graph.port)  # where nobody answers
    graph.spin_until(
        lambda: ('roller_speed', '/rig') in graph.node.get_node_names_and_namespaces()
    )
    assert graph.end('roller_speed', signal.SIGTERM, ENDS_S) == 0


def test_the_speed_node_takes_the_roller_to_the_safe_speed_before_it_ends(graph) -> None:
    speeds = graph.collect(TwistStamped, 'speed')
    graph.start('rig_simulator', port=graph.port, initial_speed_mps=8.0)
    drive = {'port': graph.port, 'safe_speed_mps': 6.5, 'safe_deceleration_mps2': 0.5}
    process = graph.start('roller_speed', **drive)
    graph.spin_until(lambda: speeds, 60.0)
    process.send_signal(signal.SIGTERM)
    process.send_signal(signal.SIGINT)  # the group and its leader each pass it on
    graph.spin_until(lambda: process.poll() is not None, 30.0)
    assert process.returncode == 0
    assert speeds[0].twist.linear.x == pytest.approx(8.0, abs=0.1)
    assert speeds[-1].twist.linear.x == pytest.approx(6.5, abs=0.1)


def test_a_recorder_that_runs_closes_its_recording(graph) -> None:
    graph.start('bag_recorder')
    graph.spin_until(lambda: list(graph.folder.glob('recordings/*.active')))
    assert graph.end('bag_recorder', signal.SIGTERM, ENDS_S) == 0
    assert not list(graph.folder.glob('recordings/*.active'))
