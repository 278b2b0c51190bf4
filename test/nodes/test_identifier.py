"""The identifier: refitting, going back, and work that fails in a way nobody thought of."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import pytest
from made import sweep_bag
from processes import children
from std_msgs.msg import String

from hunt_ros.detection.acceptance import is_rolled_back
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.nodes.normal_form_identifier import NormalFormIdentifierNode
from hunt_ros.nodes.support.form_files import FormFiles
from hunt_ros.nodes.support.qos import latched


@pytest.mark.slow
def test_a_refit_rests_on_all_recordings_and_a_revert_leaves_the_last_one_out(graph) -> None:
    closing = graph.node.create_publisher(String, 'recording/closed', latched())
    forms = graph.collect(String, 'hunting/normal_form', latched())
    health = graph.told(of='identifier')
    directory = graph.folder / 'forms'
    bags = [sweep_bag(graph.folder, seed) for seed in (1, 2, 3)]
    graph.start('normal_form_identifier', directory=directory)

    def close(count: int) -> IdentifiedNormalForm:
        closing.publish(String(data=str(bags[count - 1])))
        graph.spin_until(lambda: len(forms) >= count, 120.0)
        return IdentifiedNormalForm.from_yaml(forms[-1].data)

    def recordings() -> int:
        graph.spin(1.5)
        return int(health.last['recordings'])

    first = close(1)
    second = close(2)
    assert second.form != first.form
    assert recordings() == 2
    files = FormFiles(directory)
    assert len(files.earlier()) == 1

    # Started again, it publishes what it kept, and knows what that rests on.
    graph.end('normal_form_identifier')
    health.clear()
    graph.start('normal_form_identifier', directory=directory)
    graph.spin_until(lambda: len(forms) == 3 and health, 60.0)
    assert IdentifiedNormalForm.from_yaml(forms[-1].data).form == second.form
    assert recordings() == 2

    assert graph.call('hunting/revert_normal_form').success
    graph.spin_until(lambda: len(forms) == 4)
    back = IdentifiedNormalForm.from_yaml(forms[-1].data)
    assert is_rolled_back(back)
    assert back.form == first.form
    assert files.newest.read_text() == forms[-1].data
    assert recordings() == 1

    bags += [bags[2], bags[2]]
    third = close(5)
    assert not is_rolled_back(third)
    assert recordings() == 2, 'the recording that was gone back from stays out'
    again = graph.call('hunting/revert_normal_form')
    assert again.success
    refused = graph.call('hunting/revert_normal_form')
    assert not refused.success
    assert 'no earlier normal form' in refused.message


BAGS = Path(__file__).resolve().parents[2] / 'bags'


def _at_work(node: int = os.getpid()) -> list[int]:
    """Return the processes of a node that identify."""
    return children(node, '--multiprocessing-fork')


def test_work_that_is_killed_is_told_and_the_next_recording_is_tried_again(
    graph, resident
) -> None:
    health = graph.told()
    forms = graph.collect(String, 'hunting/normal_form', latched())
    closing = graph.node.create_publisher(String, 'recording/closed', latched())
    resident(NormalFormIdentifierNode, directory=graph.folder / 'forms')
    first, second = (
        shutil.copytree(BAGS / 'hysteresis_loop', graph.folder / f'bag_{k}') for k in (1, 2)
    )
    closing.publish(String(data=str(first)))
    graph.spin_until(_at_work, 60.0)
    (child,) = _at_work()
    graph.spin_until(lambda: os.getpriority(os.PRIO_PROCESS, child) == min(19, os.nice(0) + 10))
    os.kill(child, signal.SIGKILL)

    graph.spin_until(lambda: health.says('its process was killed', level='ERROR'))
    answer = graph.call('identify')
    assert not answer.success
    assert 'its process was killed' in answer.message
    graph.spin_until(_at_work, 60.0)  # again, because it was asked for
    closing.publish(String(data=str(second)))
    graph.spin_until(lambda: forms, 120.0)
    assert str(first) in forms[-1].data, 'the one of the failure is used'


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGKILL])
def test_work_ends_with_its_node(graph, number) -> None:
    closing = graph.node.create_publisher(String, 'recording/closed', latched())
    process = graph.start('normal_form_identifier', directory=graph.folder / 'forms')
    endless = graph.folder / 'endless.mcap'
    os.mkfifo(endless)  # nobody ever writes it
    closing.publish(String(data=str(endless)))
    graph.spin_until(lambda: _at_work(process.pid), 60.0)
    (child,) = _at_work(process.pid)
    graph.end('normal_form_identifier', number)
    graph.spin_until(lambda: not Path(f'/proc/{child}').exists(), 60.0)
    assert not list((graph.folder / 'forms').glob('*'))


def test_a_recording_that_determines_no_normal_form_is_told_with_what_is_missing(
    graph, resident
) -> None:
    health = graph.told()
    closing = graph.node.create_publisher(String, 'recording/closed', latched())
    resident(NormalFormIdentifierNode, directory=graph.folder / 'forms')
    closing.publish(String(data=str(BAGS / 'kick_decays')))

    def why() -> str:
        texts = [one['message'] for one in health]
        return next((t for t in texts if 'do not determine a normal form: ' in t), '')

    graph.spin_until(why, 120.0)
    assert why().split(': ', 1)[1], 'the reason'
