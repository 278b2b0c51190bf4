"""Means over blocks keep the amplitude, and what dropped out stays out."""

from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.identification.record.channels import Channels

HZ, RATE_HZ, AMPLITUDE = 2.8, 2000.0, 5e-4


def channels(time: np.ndarray) -> Channels:
    lateral = AMPLITUDE * np.cos(2.0 * np.pi * HZ * time)
    return Channels('', 0, time, lateral, 7.0 + 0.1 * time, 20.0 * time, RATE_HZ)


def test_a_sinusoid_keeps_its_amplitude_and_the_other_channels_their_time() -> None:
    one = channels(np.arange(0.0, 30.0, 1.0 / RATE_HZ)).averaged(HZ)
    assert 40.0 <= one.rate_hz / HZ < 50.0
    wave = AMPLITUDE * np.cos(2.0 * np.pi * HZ * one.time)
    np.testing.assert_allclose(one.lateral, wave, atol=1e-5 * AMPLITUDE)
    np.testing.assert_allclose(one.speed, 7.0 + 0.1 * one.time)
    np.testing.assert_allclose(one.roller, 20.0 * one.time)
    assert one.averaged(HZ).time.size == one.time.size  # nothing is left to average


def test_drop_outs_leave_the_mean_of_the_others_and_a_gap_leaves_none() -> None:
    time = np.arange(0.0, 30.0, 1.0 / RATE_HZ)
    whole = channels(time[(time < 10.0) | (time > 12.0)])
    known = np.random.default_rng(0).uniform(size=whole.time.size) > 0.1
    lateral = np.where(known & (whole.time < 25.0), whole.lateral, np.nan)
    one = Channels('', 0, whole.time, lateral, whole.speed, whole.roller, whole.rate_hz).averaged(
        HZ
    )
    told = np.isfinite(one.lateral)
    assert told[one.time < 9.9].mean() > 0.99
    assert not told[one.time > 25.1].any()
    assert not told[(one.time > 10.1) & (one.time < 11.9)].any()
    wave = AMPLITUDE * np.cos(2.0 * np.pi * HZ * one.time)
    assert np.abs(one.lateral - wave)[told].max() == pytest.approx(0.0, abs=1e-3 * AMPLITUDE)
