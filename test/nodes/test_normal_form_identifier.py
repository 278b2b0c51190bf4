"""Refitting and going back on real nodes."""

from __future__ import annotations

import pytest
from made import sweep_bag
from std_msgs.msg import String

from hunt_ros.detection.acceptance import is_rolled_back
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.nodes.support.form_files import FormFiles
from hunt_ros.nodes.support.qos import latched

pytestmark = pytest.mark.slow


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
