"""Recordings prepared by other processes: the same result, and no samples brought here."""

from __future__ import annotations

import os
import signal
from functools import partial

import numpy as np
import pytest
from made import up_and_down

from hunt_ros.bag import read_record, write_record
from hunt_ros.cli.main import main
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.simulation import SimulationSettings, simulate
from hunt_ros.errors import BagError, IdentificationError
from hunt_ros.identification import IdentificationSettings, identify
from hunt_ros.identification.record.hunting_frequency import looked_at
from hunt_ros.identification.record.screening import Stretch
from hunt_ros.samples import Record

distributed = pytest.importorskip('distributed', reason='the extra cluster is not installed')


def recording(seed: int) -> Record:
    """A short staircase of the simulated rig."""
    profile = up_and_down(np.arange(6.0, 8.9, 0.4), 12.0)
    settings = SimulationSettings(sample_rate_hz=100.0, broadband=2e-5)
    return simulate(paper_rig(), settings, profile, seed=seed)


@pytest.fixture(scope='module')
def readings(tmp_path_factory):
    """What reads three recordings, in whatever process."""
    folder = tmp_path_factory.mktemp('bags')
    return [
        partial(read_record, write_record(folder / str(seed), recording(seed)))
        for seed in range(3)
    ]


@pytest.fixture(scope='module')
def local():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        yield cluster


@pytest.fixture(scope='module')
def here(readings):
    return identify([reading() for reading in readings])


def test_a_cluster_gives_the_result_of_one_process(here, readings, local):
    settings = IdentificationSettings(cluster=local.scheduler_address)
    told: list[float] = []
    found = identify(readings, settings, told.append)
    assert found.to_json() == here.to_json()
    assert told == sorted(told)
    assert told[-1] == 1.0
    # No samples were brought here.
    assert not found.records
    assert len(here.records) == len(readings)


def test_a_worker_that_is_lost_changes_nothing(here, readings, local):
    lost: list[int] = []

    def lose(fraction: float) -> None:
        if not lost:  # it holds what it has read
            lost.append(local.workers[0].pid)
            os.kill(lost[0], signal.SIGKILL)

    settings = IdentificationSettings(cluster=local.scheduler_address)
    found = identify(readings, settings, lose)
    assert lost
    assert found.to_json() == here.to_json()


def test_the_verb_gives_the_same_with_a_cluster(readings, local, tmp_path):
    bags = [str(reading.args[0]) for reading in readings]
    for name, words in (('here', []), ('there', ['--cluster', local.scheduler_address])):
        assert main(['identify', *bags, *words, '--json', str(tmp_path / name)]) == 0
    assert (tmp_path / 'here').read_text() == (tmp_path / 'there').read_text()


def test_what_a_worker_raises_is_raised_here(readings, local, tmp_path):
    settings = IdentificationSettings(cluster=local.scheduler_address)
    with pytest.raises(BagError, match='nowhere'):
        identify([*readings, partial(read_record, tmp_path / 'nowhere')], settings)


def test_a_cluster_that_does_not_answer_is_named(readings):
    with pytest.raises(IdentificationError, match='nonsense://nowhere'):
        identify(readings, IdentificationSettings(cluster='nonsense://nowhere'))


@pytest.mark.parametrize(('hours', 'chosen'), [(2.0, 12), (4.0, 6), (20.0, 2)])
def test_lines_are_looked_for_in_no_more_than_a_machine_holds(hours, chosen):
    stretches = [Stretch(str(k), 300.0 * hours, 1e-4 * (k % 5), 7.0) for k in range(12)]
    places = looked_at(stretches)
    assert len(places) == chosen
    assert places == sorted(places)
    # The largest motion is among them.
    assert any(stretches[k].swing == 4e-4 for k in places)
