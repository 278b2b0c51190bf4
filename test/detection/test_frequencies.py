"""Where the detector looks: the settings first, then the normal form; elsewhere it says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fed import Fed
from hypothesis import given
from hypothesis import strategies as st
from made import record_of, words

from hunt_ros.detection import DetectorConfig, HuntingDetector, Level, State, detect
from hunt_ros.detection.configuration import with_frequency
from hunt_ros.detection.offline import frequency_for
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.samples import Record, Series


def stretched(record: Record, factor: float) -> Record:
    """The same rig, slower or faster; the speed stays, so that the form holds for both."""
    return Record(
        {
            name: Series(np.round(one.stamps_ns * factor).astype(np.int64), one.values)
            for name, one in record.items()
        }
    )


def slower(form: IdentifiedNormalForm, factor: float) -> IdentifiedNormalForm:
    scales = {
        'frequency_hz': form.form.frequency_hz / factor,
        'time_scale': form.form.time_scale * factor,
    }
    return replace(form, form=replace(form.form, **scales))


@given(st.floats(0.02, 300.0), st.floats(8.0, 100.0))
def test_whatever_the_form_says_there_is_a_range(form_hz, rows) -> None:
    asked = DetectorConfig(output_rate_hz=min(rows * 2.84, 1000.0))
    found = with_frequency(asked, form_hz)
    lowest, highest = found.followed_hz
    assert lowest < found.hunting_frequency_hz < highest
    assert with_frequency(found, 1.0) == found


def test_what_is_told_counts_the_periods_of_the_form(true_form) -> None:
    """A form that hunts half as fast: a speed is cleared after twice the time."""
    detector = HuntingDetector(DetectorConfig(), true_form)
    assert detector.clearances.least_s == 20
    detector.set_normal_form(slower(true_form, 2.0))
    assert detector.clearances.least_s == pytest.approx(40, abs=2)


def test_nothing_given_is_the_usual_range_and_a_near_form_leaves_it() -> None:
    asked = DetectorConfig()
    assert with_frequency(asked).followed_hz == asked.followed_hz == (1.0, 6.0)
    for form_hz, present_hz, expected in (
        (2.5, 2.84, 2.84),
        (None, 0.8, 0.8),
        (0.8, 2.84, 0.8),
    ):
        found = with_frequency(asked, form_hz, present_hz)
        assert found.hunting_frequency_hz == expected
        assert found.followed_hz == pytest.approx((expected / 2.84, 6.0 * expected / 2.84))
    named = replace(asked, hunting_frequency_hz=5.0)
    assert with_frequency(named, 0.8) == named


@pytest.mark.parametrize('factor', [3.6, 0.35])
def test_the_frequency_of_the_form_is_followed(recorded, true_form, factor) -> None:
    record = stretched(recorded(7.2, 30.0, kicks=[(5.0, 330e-6)]), factor)
    form = slower(true_form, factor)
    output = detect(HuntingDetector(normal_form=form), record)
    assert 'limit_cycle' in words(output)
    assert 'motion_outside_range' not in words(output)
    last = output.estimates[-1]
    usual = detect(HuntingDetector(normal_form=true_form), stretched(record, 1.0 / factor))
    truth = usual.estimates['lateral_amplitude'][-1]
    assert last['lateral_amplitude'] == pytest.approx(truth, rel=0.03)
    assert last['frequency_hz'] == pytest.approx(2.84 / factor, rel=0.1)


@pytest.mark.parametrize('factor', [3.6, 0.35])
def test_motion_outside_is_an_event_and_its_end_another(factor) -> None:
    t = np.arange(0.0, 90.0, 0.005)
    motion = np.where(t < 30.0, 4e-4 * np.cos(2.0 * np.pi * 2.84 / factor * t), 0.0)
    noise = 2e-6 * np.random.default_rng(1).normal(size=t.size)
    config = DetectorConfig(channels=('lateral', 'speed'))
    output = detect(HuntingDetector(config), record_of(t, lateral=motion + noise, speed=20.0))
    events = [e for e in output.events if e.event.startswith('motion_outside')]
    names = [event.event for event in events]
    assert names[0] == 'motion_outside_range'
    assert names[-1] == 'motion_outside_range_over'
    assert names.count('motion_outside_range_over') == 1
    assert len(names) <= 4
    said = [event.cause for event in events[:-1]]
    assert any(f'at {2.84 / factor:.1f}'[:4] in words for words in said)
    assert all('set hunting_frequency_hz' in words for words in said)
    begin, over = events[0].stamp_ns, events[-1].stamp_ns
    rows = output.estimates
    outside = (rows['stamp_ns'] >= begin) & (rows['stamp_ns'] < over)
    assert (rows['level'][outside] != Level.OK).all()


def test_a_form_of_another_frequency_that_arrives_is_replayed_bit_for_bit(
    recorded, true_form
) -> None:
    record = stretched(recorded(7.2, 30.0, kicks=[(5.0, 330e-6)]), 0.35)
    form = slower(true_form, 0.35)
    rig, step = Fed(HuntingDetector()), 100_000_000
    for now in rig.play(record, range(step, 105 * step + 1, step), clock=lambda now: None):
        if now == 40 * step:
            rig.outputs.append(rig.detector.set_normal_form(form))
    rig.outputs.append(rig.detector.finish())
    rig.assert_replayed()
    live = rig.output.estimates
    assert set(live['followed_max_hz'][:395]) == {6.0}
    assert live['followed_max_hz'][-1] == pytest.approx(6.0 / 0.35, rel=0.02)
    assert live['state'][-1] == State.LIMIT_CYCLE


@pytest.mark.parametrize('factor', [3.6, 0.35])
def test_a_record_tells_its_frequency_where_nobody_has(recorded, factor) -> None:
    record = stretched(recorded(7.2, 30.0, kicks=[(5.0, 330e-6)]), factor)
    config, remarks = frequency_for(record, DetectorConfig())
    assert config.hunting_frequency_hz == pytest.approx(2.84 / factor, rel=0.1)
    assert len(remarks) == 1
    asked = DetectorConfig(hunting_frequency_hz=2.84)
    assert frequency_for(record, asked)[0] == asked
    plain = recorded(7.2, 30.0, kicks=[(5.0, 330e-6)])
    assert frequency_for(plain, DetectorConfig()) == (DetectorConfig(), [])


@pytest.mark.parametrize(
    'kind', ['hum', 'roller', 'no roller', 'unknown ratio', 'drift', 'nothing']
)
def test_hum_roughness_and_drift_are_not_taken_for_hunting(kind) -> None:
    rng = np.random.default_rng(7)
    time = np.arange(0.0, 120.0, 0.004)
    speed = np.interp(time, [0.0, 20.0, 60.0, 80.0, 120.0], [5.0, 5.0, 7.2, 7.2, 6.0])
    turns = np.cumsum(speed) * 0.004 / (np.pi * 0.3)
    lateral = 5e-6 * rng.normal(size=time.size)
    lateral += {
        'hum': 2e-4 * np.sin(2.0 * np.pi * 50.0 * time),
        'roller': 2e-4 * np.cos(2.0 * np.pi * turns),
        'no roller': 2e-4 * np.cos(2.0 * np.pi * turns),
        'unknown ratio': 2e-4 * np.cos(2.0 * np.pi * 1.37 * turns),
        'drift': 1e-5 * np.cumsum(rng.normal(size=time.size)) * 0.063,
        'nothing': 0.0,
    }[kind]
    channels = {'lateral': lateral, 'speed': speed}
    if kind in ('hum', 'roller'):
        channels['roller'] = 2.0 * np.pi * turns
    record = record_of(time, **channels)
    found, remarks = frequency_for(record, DetectorConfig())
    assert found == DetectorConfig()
    # What is known by the encoder needs no words.
    forced = {'no roller': '1.06 v Hz', 'unknown ratio': '1.45 v Hz'}.get(kind)
    assert len(remarks) == (forced is not None)
    assert all(f'line at {forced}: forced' in remark for remark in remarks)
    if kind == 'unknown ratio':
        return
    output = detect(HuntingDetector(DetectorConfig(channels=tuple(channels))), record)
    assert 'motion_outside_range' not in words(output)
