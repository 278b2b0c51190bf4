"""The lines of the roller are told from the hunting, also where they lie beside it."""

from __future__ import annotations

import numpy as np
import pytest
from made import forced_mode

from hunt_ros.identification.record.channels import Channels
from hunt_ros.identification.record.hunting_frequency import tracked_envelope
from hunt_ros.identification.record.lines import free_of_lines
from hunt_ros.identification.settings import IdentificationSettings

HZ, RATE, LINE = 2.8, 100.0, 2e-5
TIME = np.arange(0.0, 200.0, 1.0 / RATE)


def channels(hunting: np.ndarray, turns_per_s: np.ndarray | float, line: float = LINE) -> Channels:
    """Hunting as a complex phasor in the frame of HZ, a line of the roller, noise of 2 um."""
    roller = 2 * np.pi * np.cumsum(np.broadcast_to(turns_per_s, TIME.shape)) / RATE
    noise = 2e-6 * np.random.default_rng(9).standard_normal(TIME.size)
    lateral = (hunting * np.exp(2j * np.pi * HZ * TIME)).real + line * np.cos(roller + 1) + noise
    return Channels('made up', 0, TIME, lateral, np.full(TIME.size, 7.0), roller, RATE)


def wandering(seed: int, size: float = 3e-5, damping: float = 0.3) -> np.ndarray:
    """Phasor of a damped mode that noise drives."""
    rng = np.random.default_rng(seed)
    return forced_mode(rng, TIME.size, 1.0 / RATE, damping, size / np.sqrt(2.0))


@pytest.mark.parametrize('apart', [0.07, 0.15, 0.3, 0.67, 2.0])
def test_a_line_beside_the_hunting_is_found_and_leaves_no_hole(apart: float) -> None:
    found, settings = [], IdentificationSettings(lines=(1.0,))
    for seed in range(6):
        hunting = wandering(seed)
        envelope, _ = tracked_envelope(channels(hunting, HZ * (1 + apart)), HZ, settings)
        assert np.isfinite(envelope.amplitude).all()
        size = np.interp(envelope.time, TIME, np.abs(hunting))
        assert np.mean(envelope.amplitude**2) == pytest.approx(np.mean(size**2), rel=0.3)
        found.append(np.sqrt(np.median(envelope.line_power)))
    assert np.median(found) == pytest.approx(LINE, rel=0.25)


def test_a_line_that_passes_the_hunting_is_left_out_on_the_way() -> None:
    turns = np.linspace(0.7, 1.4, TIME.size) * HZ
    clean, power = free_of_lines(
        channels(np.zeros(TIME.size), turns), np.full(TIME.size, HZ), np.array([1.0])
    )
    assert np.sqrt(power) == pytest.approx(LINE, rel=0.1)
    assert np.std(clean.lateral) == pytest.approx(2e-6, rel=0.1)


@pytest.mark.parametrize('line', [0.0, LINE])
def test_a_kick_and_a_limit_cycle_make_no_line(line: float) -> None:
    off = []
    for seed in range(6):
        hunting = wandering(seed)
        hunting[TIME > 60.0] += 5e-4 * np.exp(-0.2 * (TIME[TIME > 60.0] - 60.0))
        hunting[TIME > 120.0] = 1e-3 * np.exp(0.1j * TIME[TIME > 120.0])
        seen, turns = channels(hunting, 1.2 * HZ, line), np.full(TIME.size, HZ)
        _, power = free_of_lines(seen, turns, np.array([1.0]))
        off.append(np.abs(np.sqrt(power) - line))
    assert np.median(off) < 0.2 * LINE
    assert np.max(off) < LINE
