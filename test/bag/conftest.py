"""One recording that the tests of this room share."""

from __future__ import annotations

from pathlib import Path

import pytest
from bags_made import make_record

from hunt_ros.bag import BagWriter
from hunt_ros.bag.record_writer import messages_of
from hunt_ros.samples import Record


@pytest.fixture(scope='session')
def record() -> Record:
    return make_record()


@pytest.fixture(scope='session')
def bag(record: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bag') / 'run'
    with BagWriter(path, notes=record.notes) as writer:
        form = writer.topic('/rig/hunting/normal_form', 'std_msgs/msg/String', latched=True)
        writer.write(form, record.start_ns, b'\0\1\0\0\7\0\0\0v_c: 8\0')
        for message in messages_of(record, writer.topic, 'rig'):
            writer.write(*message)
    return path
