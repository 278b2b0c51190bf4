"""Recordings that the tests of this room share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hunt_ros.bag import write_record
from hunt_ros.samples import Record, Series

BEGIN_NS = 1_700_000_000_000_000_000


def make_record(seconds: float = 8.0, rate_hz: float = 1000.0, seed: int = 0) -> Record:
    """Noise on all four channels, at rates of their own, with ns that do not fit a float."""
    rng = np.random.default_rng(seed)
    count = round(seconds * rate_hz)
    fast = BEGIN_NS + np.round(np.arange(count) * 1e9 / rate_hz).astype(np.int64)
    slow = fast[::10] + 123
    return Record(
        {
            'lateral': Series(fast, rng.normal(size=count)),
            'yaw': Series(fast + 7, rng.normal(size=count)),
            'roller': Series(slow, np.cumsum(rng.uniform(size=slow.size))),
            'speed': Series(slow + 1, rng.uniform(6, 9, size=slow.size)),
        },
        'made',
        {'rig': 'the rig', 'operator': 'the operator'},
    )


def assert_same(left: Record, right: Record) -> None:
    """Every sample of both, bit for bit."""
    assert set(left) == set(right)
    for name in left:
        np.testing.assert_array_equal(left[name].stamps_ns, right[name].stamps_ns, name)
        np.testing.assert_array_equal(left[name].values, right[name].values, name)


@pytest.fixture(scope='session')
def record() -> Record:
    return make_record()


@pytest.fixture(scope='session')
def bag(record: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_record(
        tmp_path_factory.mktemp('bag') / 'run', record, texts={'hunting/normal_form': 'v_c: 8'}
    )


@pytest.fixture(scope='session')
def same() -> Callable[[Record, Record], None]:
    return assert_same


@pytest.fixture(scope='session')
def new_record() -> Callable[..., Record]:
    return make_record
