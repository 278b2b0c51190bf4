"""The decisions alone, on amplitudes that are given: what several tests share."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import decisions
from hunt_ros.detection.decision.form import FormNumbers, fill_branches, form_numbers
from hunt_ros.detection.decision.rules import Rules, rules_of
from hunt_ros.detection.output import blank_rows

RULES = rules_of(DetectorConfig(), 6.4, 8.0)
ROWS = 100  # in a second
QUIET = 20e-6  # r.m.s. of the quiet motion, m


def noise(
    seconds: float,
    damping: float = 0.35,
    rms: float = QUIET,
    seed: int | np.random.Generator = 1,
    lag_s: float = 0.0,
) -> np.ndarray:
    """Return the phasor of narrow-band noise, m, seen through a filter of so much lag."""
    rng = np.random.default_rng(seed)
    keep = math.exp(-damping / ROWS)
    shocks = rng.normal(size=(round(seconds * ROWS), 2)) @ np.array([1.0, 1j])
    z = lfilter([math.sqrt(0.5 * (1.0 - keep**2))], [1.0, -keep], rms * shocks)
    if lag_s:
        last = math.exp(-1.0 / ROWS / lag_s)
        z = lfilter([1.0 - last], [1.0, -last], z)
    return np.asarray(z)


def decided(
    amplitude: np.ndarray,
    rules: Rules = RULES,
    form: FormNumbers | None = None,
    memory: np.ndarray | None = None,
    speed: float | np.ndarray = math.nan,
    std: float | np.ndarray = 1e-6,
) -> np.ndarray:
    """Return the rows of an amplitude that is known to 1 um, or to `std`, m."""
    rows = blank_rows(np.zeros(amplitude.size, dtype=np.int64))
    rows['speed'], rows['step'] = speed, 0.0
    rows['judged'], rows['judged_std'] = amplitude, std
    numbers = form or form_numbers(None)
    fill_branches(numbers, rows)
    none, all_of_it = np.zeros(amplitude.size, np.bool_), np.ones(amplitude.size, np.bool_)
    decisions.decide(
        rules,
        numbers,
        decisions.fresh_memory() if memory is None else memory,
        none,
        all_of_it,
        rows,
    )
    return rows
