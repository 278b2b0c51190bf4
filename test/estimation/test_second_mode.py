"""A second mode that is not the one guessed: the amplitude after a kick is as sure as it says."""

from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.estimation.kalman import HuntingTracker, ModePoint, TrackerConfig

#: Guesses, Hz and 1/s, of a second mode that really has 3.3 Hz and 9.4 1/s.
GUESSES = [(3.3, 18.0), (5.5, 9.4), (1.8, 6.0), (3.3, 9.4)]
KICK_S = 4.0


def scores(hunting_signal, sensors, since, doubt=0.5):
    """Error over std of the amplitude at times since a kick, over guesses and seeds; clipped."""
    found = []
    for hz, decay in GUESSES:
        for seed in range(4):
            signal = hunting_signal(
                seed,
                5.5,
                500.0,
                amplitude=2e-5,
                kick_at=KICK_S,
                kick=2e-4,
                second=2e-4,
                noise=5e-6,
            )
            mode = ModePoint(0.0, 2.84, hz, decay, second_std=doubt)
            tracker = HuntingTracker(TrackerConfig(modes=(mode,)))
            rows, phasor = signal.track(tracker, sensors)
            at = np.round((KICK_S + np.array(since)) * 100).astype(int) - 1
            error = rows['lateral_amplitude'][at] - np.abs(phasor[at])
            found.append(np.clip(error / rows['lateral_amplitude_std'][at], -5.0, 5.0))
    return np.sqrt(np.mean(np.square(found), axis=0))


@pytest.mark.parametrize('sensors', [(0,), (0, 1)], ids=['lateral', 'both'])
def test_the_amplitude_after_a_kick_is_as_sure_as_it_says(hunting_signal, sensors):
    since = (0.15, 0.2, 0.3, 0.4)
    honest = scores(hunting_signal, sensors, since)
    assert honest.max() < 2.0
    assert scores(hunting_signal, sensors, since, doubt=0.0).max() > 1.5 * honest.max()


def test_the_doubt_dies_with_the_second_mode(hunting_signal):
    signal = hunting_signal(0, 7.0, 500.0, amplitude=2e-4, kick_at=KICK_S, kick=1e-4, noise=5e-6)
    known, _ = signal.track(HuntingTracker(TrackerConfig(modes=(ModePoint(0.0, 2.84, 3.3, 9.4),))))
    guessed, _ = signal.track(HuntingTracker())
    ratio = guessed['lateral_amplitude_std'] / known['lateral_amplitude_std']
    assert np.array_equal(ratio[99:399], np.ones(300))  # no kick, no doubt
    assert ratio[419] > 1.5
    assert ratio[-1] < 1.2
