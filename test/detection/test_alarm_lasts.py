"""No evidence ends no hunting: not a new form, a reset clock, a silent channel or a pause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fed import Moving
from made import SECOND

from hunt_ros.detection import Level, State, health
from hunt_ros.detection.output import EVENT_NUMBERS, seconds_text
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.errors import ConfigError
from hunt_ros.samples import Uncertain


def rest(seconds: float, rate_hz: float = 200.0) -> np.ndarray:
    """Return a quiet amplitude, m: what holds as well as a limit cycle passes for one."""
    return 20e-6 * (1.0 + 0.5 * np.sin(2.0 * np.arange(round(seconds * rate_hz)) / rate_hz))


def hunting(seconds: float = 12.0, rate_hz: float = 200.0) -> np.ndarray:
    """Return a second of rest, then growth to the limit cycle, m."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    return np.minimum(20e-6 * np.exp(np.maximum(t - 3.0, 0.0)), 630e-6)


def hunts(rig: Moving) -> None:
    rig.move(hunting())
    assert rig.detector.status.state is State.LIMIT_CYCLE
    assert rig.detector.status.alarm


@pytest.mark.parametrize('frequency_hz', [3.6, 8.0, 12.0])
@pytest.mark.parametrize('seed', range(4))
def test_a_form_at_another_frequency_ends_no_hunting(frequency_hz: float, seed: int) -> None:
    rig = Moving(seed=seed)
    rig.move(hunting())
    assert rig.detector.status.state is State.LIMIT_CYCLE
    rig.detector.acknowledge()
    form = replace(PAPER_NORMAL_FORM, frequency_hz=frequency_hz)
    rig.detector.set_normal_form(IdentifiedNormalForm(form))
    words = rig.move(np.full(2000, 630e-6))
    assert not {'quiet', 'decaying'} & set(words)
    assert rig.detector.status.alarm
    assert rig.detector.status.state is State.LIMIT_CYCLE


def test_a_clock_set_back_ends_no_hunting() -> None:
    rig = Moving()
    hunts(rig)
    rig.detector.acknowledge()
    words = rig.move(np.full(2000, 630e-6), start_s=2.0)
    assert not {'quiet', 'decaying', 'limit_cycle'} & set(words)
    assert rig.detector.status.alarm
    assert rig.detector.status.state is State.LIMIT_CYCLE
    decay = 630e-6 * np.exp(-0.8 * np.arange(3000) / 200.0)
    words = rig.move(np.maximum(decay, 2e-6), start_s=12.0, speed=6.0)
    assert words.index('decaying') < words.index('quiet')
    assert not rig.detector.status.alarm, 'acknowledged, and now it is over'


def test_without_speed_a_growing_motion_does_not_decay() -> None:
    rig = Moving()
    begun = 300e-6 * np.exp(0.5 * np.arange(200) / 200.0)
    rig.move(np.concatenate((rest(6.0), begun)))
    assert rig.detector.status.state is State.ESCAPING
    grown = 300e-6 * np.exp(0.5 * (7.0 + np.arange(600) / 200.0 - 6.0))
    words = rig.move(grown, start_s=7.0, speed=np.nan)
    assert 'decaying' not in words
    rig.detector.acknowledge()
    assert rig.detector.status.alarm
    falling = grown[-1] * np.exp(-0.8 * np.arange(2000) / 200.0)
    words = rig.move(falling, start_s=10.0, speed=np.nan)
    assert 'decaying' in words, 'a decay is seen without a speed, too'


@pytest.mark.parametrize('output_rate_hz', [50.0, 200.0, 1000.0])
def test_a_slow_decay_is_seen_at_any_rate_of_the_rows(output_rate_hz: float) -> None:
    rig = Moving(form=None, output_rate_hz=output_rate_hz)
    rig.move(np.full(10_000, 630e-6), rate_hz=1000.0)
    assert rig.detector.status.state is State.LIMIT_CYCLE
    decay = 630e-6 * np.exp(-0.2 * np.arange(6000) / 1000.0)
    rig.move(decay, rate_hz=1000.0)
    (event,) = (e for e in rig.output.events if e.event == 'decaying')
    assert 10.2e9 < event.stamp_ns < 12.5e9


def test_settings_change_while_it_runs_and_the_change_is_replayed() -> None:
    rig = Moving(form=None)
    rig.move(np.full(2400, 630e-6))
    assert rig.detector.status.state is State.LIMIT_CYCLE
    floor = rig.detector.status.number('noise_floor_m')
    config = replace(
        rig.detector.config,
        nonlinear_critical_speed_mps=6.4,
        critical_speed_mps=8.0,
        lateral_range_m=600e-6,
        least_damping_per_s=0.08,
    )
    rig.outputs.append(rig.detector.reconfigure(config))
    words = rig.move(np.full(600, 630e-6), start_s=12.0)
    assert {'hysteresis_entered', 'sensor_fault'} <= set(words)
    assert rig.detector.status.state is State.LIMIT_CYCLE
    assert rig.detector.status.alarm
    assert rig.detector.status.number('noise_floor_m') == pytest.approx(floor, rel=0.2)
    rig.assert_replayed()
    with pytest.raises(ConfigError, match='output_rate_hz'):
        rig.detector.reconfigure(replace(config, output_rate_hz=50.0))


def test_an_event_says_when_it_began_and_why() -> None:
    rig = Moving()
    hunts(rig)
    events = {event.event: event for event in rig.output.events}
    cycle = events['limit_cycle']
    assert 0 < cycle.stamp_ns - cycle.since_ns < SECOND
    assert 'has reached the limit cycle' in cycle.cause
    escape = events['escaping']
    assert 0 < escape.stamp_ns - escape.since_ns < SECOND
    assert 'probability' in escape.cause
    lies = 'the speed 7.200 m/s lies between v_n = 6.406 m/s and v_c = 8.000 m/s'
    assert events['hysteresis_entered'].cause.startswith(lies)
    for event in events.values():
        assert event.cause
        assert event.test
        assert event.since_ns <= event.stamp_ns
        assert event.normal_form == 'v_c 8.000 m/s, v_n 6.406 m/s'
        assert set(event.numbers) == set(EVENT_NUMBERS)
    assert (escape.test, cycle.test) == ('escape_probability', 'stable_amplitude')
    numbers = escape.numbers
    low, high = numbers['escape_probability_low'], numbers['escape_probability_high']
    assert 0.0 <= low <= numbers['escape_probability'] <= high <= 1.0
    assert f'{1e3 * numbers["unstable_amplitude_m"]:.3g} mm' in escape.cause
    growth = Uncertain(numbers['growth_rate_per_s'], numbers['growth_rate_std_per_s'])
    assert f'growth rate {growth.text(" +/- ")} 1/s' in escape.cause


def test_an_event_that_the_probability_of_hunting_decided_has_it() -> None:
    rig = Moving(form=None)
    hunts(rig)
    rig.move(630e-6 * np.exp(-np.arange(2000) / 200.0), start_s=12.0)
    events = {event.event: event for event in rig.output.events}
    for name in ('escaping', 'limit_cycle', 'decaying'):
        event = events[name]
        chance = event.numbers['hunting_probability']
        assert event.test == 'hunting_probability'
        assert chance < 0.05 if name == 'decaying' else chance > 0.95
        assert 'hunting with a probability of ' in event.cause
    known = Moving()
    hunts(known)
    assert all(event.test != 'hunting_probability' for event in known.output.events)


def test_the_status_says_why_and_since_when_with_its_numbers() -> None:
    rig = Moving()
    rig.move(rest(3.0))
    status = rig.detector.status
    assert status.level is Level.WARN
    assert 'the speed 7.200 m/s lies between v_n = 6.406 m/s and v_c' in status.reasons[-1]
    assert (
        f'unstable amplitude {1e3 * status.number("unstable_amplitude_m"):.3g} mm'
        in status.reasons[-1]
    )
    assert 0 < float(str(status.values['since_s'])) < 3
    rig.move(hunting(), start_s=3.0)
    status = rig.detector.status
    events = {event.event: event for event in rig.output.events}
    cycle, escape = events['limit_cycle'], events['escaping']
    assert status.level is Level.ERROR
    # The sentence of the moment at which it was said, and for how long it has lasted.
    lasted = 1e-9 * (status.stamp_ns - cycle.since_ns)
    assert status.reasons[0] == f'limit cycle for {lasted:.1f} s, at first: {cycle.cause}'
    assert status.values['test'] == cycle.test
    assert status.values['since_s'] == seconds_text(escape.stamp_ns)
    assert status.values['state_since_s'] == seconds_text(cycle.since_ns)
    assert status.values['state_decided_s'] == seconds_text(cycle.stamp_ns)
    assert status.values['normal_form'] == cycle.normal_form


@pytest.mark.parametrize('live', [True, False])
def test_a_channel_that_is_back_says_how_long_it_was_gone(live) -> None:
    rig = Moving()
    rig.move(np.full(600, 20e-6))
    if live:
        rig.outputs.append(rig.detector.tick(5 * SECOND))
    rig.move(np.full(400, 20e-6), start_s=5.0)
    events = {event.event: event for event in rig.output.events}
    gone, back = events['input_stale'], events['input_recovered']
    assert gone.test == back.test == 'timeout'
    assert 'silent for 0.3 s' in gone.cause or 'silent for 0.5 s' in gone.cause
    assert ' is back after 2.0' in back.cause
    # A silence is no slow sampling.
    wrong = rig.output.estimates['lateral_wrong']
    assert not (wrong & health.SPARSE).any()
