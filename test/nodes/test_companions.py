"""The thread beside the detector: an error nobody expected is told, and it begins anew."""

from __future__ import annotations

from functools import partial
from queue import SimpleQueue

import numpy as np

from hunt_ros.criteria import Verdict
from hunt_ros.detection import CompanionConfig, Companions
from hunt_ros.detection.output import MOTION_DTYPE
from hunt_ros.nodes.hunting_detector import accompany
from hunt_ros.nodes.support.worker import Worker

CRITERION = CompanionConfig(criteria=('cfr_213_333',), criteria_scale=0.02, forecast='off')
SECOND = 10**9


class Told:
    """What `Diagnostics` would say."""

    def __init__(self) -> None:
        self.failures: list[str] = []

    def failed(self, task: str, error: Exception) -> None:
        self.failures.append(f'{task}: {error}')

    def done(self, task: str) -> None:
        self.failures.clear()


def _shaking(begin_s: int) -> np.ndarray:
    """Return what a detector gives out of 8 s of a limit cycle of 2 mm."""
    stamps = begin_s * SECOND + np.arange(0, 8 * SECOND, 2_000_000)
    values = 2e-3 * np.sin(2.0 * np.pi * 2.8e-9 * (stamps - stamps[0]))
    there = np.ones(stamps.size)
    columns = [stamps, values, 9.0 * there, there * np.nan, there < 0]
    return np.rec.fromarrays(columns, dtype=MOTION_DTYPE)


def test_an_error_in_the_thread_is_told_and_the_next_samples_are_judged(machine) -> None:
    verdicts: list[Verdict] = []

    def tell(verdict: Verdict) -> None:
        verdicts.append(verdict)
        if len(verdicts) == 1:
            raise ZeroDivisionError('nobody expected this')

    told = Told()
    motions: SimpleQueue = SimpleQueue()
    work = partial(accompany, Companions(CRITERION), motions, tell, told)
    worker = Worker(told.failed, 'beside', work)
    try:
        motions.put(_shaking(100))
        machine.until(lambda: told.failures)
        assert told.failures == ['criteria and forecast: nobody expected this']
        seen = len(verdicts)
        motions.put(_shaking(200))
        machine.until(lambda: len(verdicts) > seen)
        assert verdicts[-1].exceeded
        motions.put(None)  # as an operator does, and a configuration
        machine.until(lambda: not told.failures)
    finally:
        worker.stop()
