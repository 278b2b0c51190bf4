"""Signals whose every component is known, and what no estimator can do better."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import signals_made

sys.path.insert(0, str(Path(__file__).parents[1] / 'benchmark'))  # for bounds


@pytest.fixture(scope='session')
def hunting_signal() -> Callable[..., signals_made.Signal]:
    return signals_made.hunting_signal
