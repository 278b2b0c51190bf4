"""The identifier when the work fails in a way nobody thought of, and what it keeps in memory."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import String

from hunt_ros.bag import write_record
from hunt_ros.nodes import normal_form_identifier
from hunt_ros.nodes.normal_form_identifier import NormalFormIdentifierNode
from hunt_ros.nodes.support.conversions import read_diagnostic
from hunt_ros.nodes.support.qos import latched
from hunt_ros.samples import Record, Series

pytestmark = pytest.mark.ros


def _bag(folder: Path, number: int) -> Path:
    stamps = 1_700_000_000_000_000_000 + 5_000_000 * np.arange(400)
    series = {name: Series(stamps, 1e-4 * np.arange(400.0)) for name in ('lateral', 'speed')}
    return write_record(folder / f'bag_{number}', Record(series))


def test_an_error_nobody_expected_is_told_and_the_next_recording_is_tried_again(
    graph, resident, monkeypatch
) -> None:
    tried: list[int] = []
    records: list[weakref.ref[Record]] = []

    def fail(prior, new, *rest):
        records.extend(weakref.ref(record) for record in new)
        tried.append(len(new))
        raise np.linalg.LinAlgError('Singular matrix')

    monkeypatch.setattr(normal_form_identifier, 'update', fail)
    health = graph.collect(DiagnosticArray, '/diagnostics')
    closing = graph.node.create_publisher(String, 'recording/closed', latched())
    resident(NormalFormIdentifierNode, directory=graph.folder / 'forms')
    closing.publish(String(data=str(_bag(graph.folder, 1))))
    graph.spin_until(lambda: tried)

    def told() -> bool:
        texts = [read_diagnostic(message) for message in health]
        return any(t['level'] == 'ERROR' and 'Singular matrix' in t['message'] for t in texts)

    graph.spin_until(told)
    answer = graph.call('identify')
    assert not answer.success
    assert 'LinAlgError: Singular matrix' in answer.message
    closing.publish(String(data=str(_bag(graph.folder, 2))))
    graph.spin_until(lambda: 2 in tried)  # together with the one that could not be identified

    def forgotten() -> bool:
        gc.collect()
        return all(record() is None for record in records)

    graph.spin_until(forgotten)
