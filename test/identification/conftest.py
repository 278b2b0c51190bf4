"""Records that several tests share, and what is known of the paper's form without a fit."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest
from records_made import amplitude_record, staircase, sweep, trajectories
from report_made import identification_of_the_paper

from hunt_ros.identification import Identification, identify
from hunt_ros.samples import Record


@pytest.fixture(scope='session')
def records() -> dict[str, list[Record]]:
    """Records that several tests share, made once."""
    return {'trajectories': trajectories(1), 'staircase': [staircase(0)], 'sweep': [sweep(1)]}


@pytest.fixture(scope='session')
def identified(records) -> Callable[[str], Identification]:
    """Return a function that identifies some of these records, each once."""
    return cache(lambda name: identify(records[name]))


@pytest.fixture(scope='session')
def make() -> Callable[..., Record]:
    """Make a record of the amplitude equation."""
    return amplitude_record


@pytest.fixture(scope='session')
def known() -> Identification:
    """What is known of the paper's form."""
    return identification_of_the_paper()
