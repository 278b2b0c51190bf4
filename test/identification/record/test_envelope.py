from __future__ import annotations

import numpy as np
import pytest
from made import forced_mode

from hunt_ros.estimation.record_lines import RecordLines
from hunt_ros.identification.record.channels import Channels, channels_of
from hunt_ros.identification.record.envelope import envelope_of
from hunt_ros.identification.record.hunting_frequency import motion_of_channels, tracked_envelope
from hunt_ros.identification.record.lines import free_of_lines
from hunt_ros.identification.settings import FREQUENCIES_HZ, IdentificationSettings
from hunt_ros.samples import Record, Series

SETTINGS = IdentificationSettings()


def record(stamps_s, lateral, speed=7.0, roller=None) -> Record:
    stamps = np.round(np.asarray(stamps_s) * 1e9).astype(np.int64)
    channels = {
        'lateral': Series(stamps, lateral).in_order(),
        'speed': Series(stamps, np.full(stamps.size, speed)).in_order(),
    }
    if roller is not None:
        channels['roller'] = Series(stamps, roller)
    return Record(channels, 'made up')


def hunting(time, amplitude=3e-4, hz=2.8):
    return amplitude * np.cos(2 * np.pi * hz * time + 0.4)


def test_the_amplitude_is_free_of_roughness_and_bias():
    time = np.arange(0, 40, 0.005)
    roller = 7.0 / 0.15 * time
    lateral = hunting(time) + 1e-4 * np.cos(roller) + 5e-5 * np.sin(2 * roller) + 1e-3
    channels = channels_of(record(time, lateral, roller=roller))
    envelope, _ = tracked_envelope(channels, 2.8, SETTINGS)
    assert envelope.amplitude == pytest.approx(3e-4, rel=1e-3)
    assert envelope.line_power == pytest.approx(1e-8 + 2.5e-9, rel=2e-3)


def test_a_frequency_that_goes_with_the_speed_is_followed_over_a_factor_of_two():
    time = np.arange(0, 300, 0.005)
    speed = np.interp(time, [0, 20, 140, 160, 280, 300], [20, 20, 42, 42, 20, 20])
    turned = 2 * np.pi * np.cumsum(4.5 / 40.0 * speed) * 0.005
    channels = channels_of(record(time, 3e-4 * np.cos(turned), speed))
    envelope, _ = tracked_envelope(channels, 3.5, SETTINGS)
    assert envelope.frequency[[0, -1]] == pytest.approx(2.25, rel=0.02)
    assert envelope.frequency.max() == pytest.approx(4.725, rel=0.02)
    assert envelope.amplitude == pytest.approx(3e-4, rel=0.01)


def test_the_hunting_line_is_found_under_a_stronger_roughness_line():
    time = np.arange(0, 40, 0.005)
    roller = 7.0 / 0.15 * time
    channels = channels_of(
        record(time, hunting(time, 5e-5) + 3e-4 * np.cos(roller), roller=roller)
    )
    known = [1.0 / (0.3 * np.pi)]
    lines = RecordLines([motion_of_channels(channels)], FREQUENCIES_HZ, known)
    assert lines.strongest_hz == pytest.approx(2.8, abs=0.03)


def test_dropped_and_late_samples_cost_only_their_weight():
    rng = np.random.default_rng(0)
    time = np.arange(0, 40, 0.005) + rng.uniform(-0.001, 0.001, 8000)
    lateral = hunting(time)
    lateral[rng.random(8000) < 0.1] = np.nan
    order = rng.permutation(8000)
    channels = channels_of(record(time[order], lateral[order]))
    envelope = envelope_of(channels, np.full(8000, 2.8))
    assert envelope.amplitude == pytest.approx(3e-4, rel=2e-3)


def test_a_hole_gives_no_value_where_it_is_and_leaves_the_rest_alone():
    time = np.arange(0, 40, 0.005)
    lateral = hunting(time)
    lateral[(time > 15.0) & (time < 18.0)] = np.nan
    channels = channels_of(record(time, lateral))
    envelope = envelope_of(channels, np.full(time.size, 2.8))
    missing = np.isnan(envelope.amplitude)
    assert missing[(envelope.time > 15.6) & (envelope.time < 17.4)].all()
    assert not missing[(envelope.time < 14.0) | (envelope.time > 19.0)].any()


def test_noise_of_the_phasor_is_what_the_window_leaves():
    rng = np.random.default_rng(1)
    time = np.arange(0, 400, 0.01)
    channels = channels_of(record(time, hunting(time) + 2e-5 * rng.standard_normal(time.size)))
    envelope = envelope_of(channels, np.full(time.size, 2.8))
    assert np.std(envelope.amplitude) == pytest.approx(np.median(envelope.noise), rel=0.15)


# --- the lines of the roller are told from the hunting, also where they lie beside it ----------

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
