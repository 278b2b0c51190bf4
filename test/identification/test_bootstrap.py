from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hunt_ros.errors import ConfigError, IdentificationError
from hunt_ros.identification import IdentificationSettings, identify
from hunt_ros.identification.bootstrap import bootstrap
from hunt_ros.identification.fit import fit_laws
from hunt_ros.identification.growth_law import PAPER_TERMS
from hunt_ros.identification.identifying import _path
from hunt_ros.identification.preparation import Run, prepare, runs_in
from hunt_ros.identification.uncertainty import robust_covariance

SETTINGS = IdentificationSettings(jobs=1, seed=7)


def runs_of(records, settings) -> list[Run]:
    prepared = [prepare(record, k, settings) for k, record in enumerate(records, start=1)]
    found = [runs_in(one, one.digest.source, False, 2.835, settings) for one in prepared]
    return [run for runs, _ in found for run in runs]


@pytest.fixture(scope='module')
def fitted(records):
    runs = runs_of(records['trajectories'], SETTINGS)
    path, scales = _path(runs, 2.835, SETTINGS)
    return fit_laws(path, scales, SETTINGS, None, 0.02)[0]


@pytest.fixture(scope='module')
def serial(fitted):
    told: list[float] = []
    laws = bootstrap(fitted, SETTINGS, 24, told.append)
    assert told[-1] == 1.0
    assert told == sorted(told)
    return laws


def test_replications_scatter_like_the_robust_covariance(fitted, serial):
    # Of what the prior alone says the replications know nothing: the coefficients of the form.
    varied = np.arange(fitted.prior.std.size) < PAPER_TERMS
    spread = np.nanstd(serial, axis=0)[varied]
    expected = np.sqrt(np.diag(robust_covariance(fitted.fit, 30).matrix))[varied]
    assert np.all(spread < 2.2 * expected)
    assert np.all(spread > 0.35 * expected)


def test_all_cores_give_the_numbers_of_one(fitted, serial):
    parallel = bootstrap(fitted, replace(SETTINGS, jobs=2), 16)
    np.testing.assert_array_equal(parallel, serial[:16])


def test_a_cluster_gives_the_numbers_of_one_process(fitted, serial):
    distributed = pytest.importorskip('distributed', reason='the extra cluster is not installed')
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        settings = replace(SETTINGS, cluster=cluster.scheduler_address)
        shared = bootstrap(fitted, settings, 16)
    np.testing.assert_array_equal(shared, serial[:16])


def test_a_cluster_that_does_not_answer_is_named(fitted):
    pytest.importorskip('distributed', reason='the extra cluster is not installed')
    settings = replace(SETTINGS, cluster='nonsense://nowhere')
    with pytest.raises(IdentificationError, match='nonsense://nowhere'):
        bootstrap(fitted, settings, 8)


def test_intervals_from_the_bootstrap_are_those_of_the_linearised_ones_within_reason(records):
    plain = identify(records['trajectories'])
    drawn = identify(records['trajectories'], replace(SETTINGS, bootstrap=40))
    assert plain.v_n is not None
    assert drawn.v_n is not None
    assert drawn.v_n.value == plain.v_n.value
    assert 0.3 < drawn.v_n.std / plain.v_n.std < 3.0


@pytest.mark.parametrize('replications', [1, 9, 39])
def test_replications_too_few_for_an_interval_are_refused(replications):
    with pytest.raises(ConfigError, match='bootstrap must be 0 or at least 40'):
        IdentificationSettings(bootstrap=replications)
