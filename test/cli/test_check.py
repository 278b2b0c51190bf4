"""`hunt check`: a sound rig passes, and each fault of a rig is found, with what to do."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from made import Values, changed, without

from hunt_ros.bag import write_record
from hunt_ros.bag.plausible import LARGEST
from hunt_ros.cli import check as check_verb
from hunt_ros.cli.main import main
from hunt_ros.samples import Record, Series

RATE_HZ, DIAMETER_M, NOISE_M = 200.0, 0.4, 2e-5
Change = Callable[[Record], Record]


def _sound() -> Record:
    """Ten seconds of a quiet wheelset on a roller that turns."""
    random = np.random.default_rng(1)
    stamps = 10**9 + np.arange(2000) * 5_000_000
    t = (stamps - stamps[0]) * 1e-9
    slow = stamps[::2]
    motion = 1e-4 * np.sin(2.0 * np.pi * 2.8 * t) + NOISE_M * random.standard_normal(t.size)
    angle = 2.0 * 7.0 / DIAMETER_M * t[::2]
    channels = {
        'lateral': Series(stamps, np.round(motion / 1e-6) * 1e-6),
        'yaw': Series(stamps, 0.8 * motion + 2e-5 * random.standard_normal(t.size)),
        'roller': Series(slow, angle),
        'speed': Series(slow, 7.0 + 1e-3 * random.standard_normal(slow.size)),
    }
    return Record(channels)


def _other(**values: Values) -> Change:
    return lambda sound: changed(sound, **values)


def _every(step: int, channel: str) -> Change:
    """Return what leaves every so many samples of a channel."""

    def change(sound: Record) -> Record:
        series = sound[channel]
        return changed(sound, **{channel: Series(series.stamps_ns[::step], series.values[::step])})

    return change


def _jittered(sound: Record) -> Record:
    series = sound['lateral']
    shift = np.random.default_rng(2).normal(0.0, 1e6, len(series)).astype(np.int64)
    return changed(sound, lateral=Series(series.stamps_ns + shift, series.values))


def _holed(sound: Record) -> Record:
    series = sound['yaw']
    kept = np.arange(len(series)) % 100 > 4
    return changed(sound, yaw=Series(series.stamps_ns[kept], series.values[kept]))


def _wrapped_and_slow(sound: Record) -> Record:
    return _every(20, 'roller')(changed(sound, roller=lambda v: v % (2.0 * np.pi)))


def _read_at_once(sound: Record) -> Record:
    series = sound['lateral']
    within = np.arange(len(series)) % 25
    stamps = series.stamps_ns - within * 5_000_000 + within * 1000
    return changed(sound, lateral=Series(stamps, series.values))


def _noise_alone(values: np.ndarray) -> np.ndarray:
    return NOISE_M * np.random.default_rng(3).standard_normal(values.size)


#: What is wrong -> how, the check that finds it, its channel, and words of the advice.
FAULTS: dict[str, tuple[Change, str, str, str]] = {
    'no yaw': (lambda sound: without(sound, 'yaw'), 'rate', 'yaw', 'start what publishes'),
    'slow': (_every(10, 'lateral'), 'rate', 'lateral', '59.6 Hz'),
    'jitter': (_jittered, 'jitter', 'lateral', 'clock of the converter'),
    'bursts': (_read_at_once, 'jitter', 'lateral', 'with a header'),
    'lost': (_holed, 'gaps', 'yaw', 'queues'),
    'stuck': (_other(yaw=0.0), 'noise', 'yaw', 'not connected'),
    'noisy': (_other(lateral=lambda v: 10.0 * v), 'noise', 'lateral', 'shielding'),
    'coarse': (_other(lateral=lambda v: np.round(v, 4)), 'resolution', 'lateral', 'coarser'),
    'saturated': (_other(lateral=lambda v: v + 0.02), 'range', 'lateral', 'larger range'),
    'millimetres': (_other(speed=lambda v: 1e3 * v), 'unit', 'speed', 'SI'),
    'dead lateral': (_other(lateral=_noise_alone), 'motion', 'lateral', 'cable'),
    'dead yaw': (_other(yaw=_noise_alone), 'motion', 'yaw', 'cable'),
    'slow encoder': (_every(8, 'roller'), 'encoder', 'roller', 'more often'),
    'slow encoder that wraps': (_wrapped_and_slow, 'encoder', 'roller', 'more often'),
    'diameter': (_other(roller=lambda v: 1.1 * v), 'diameter', 'roller', 'counts of the encoder'),
    'speed stands still': (_other(roller=lambda v: v * v / v[-1]), 'diameter', 'roller', 'tacho'),
    'standing': (_other(roller=0.0, speed=0.0), 'encoder', 'roller', 'let it turn'),
    'dead speed': (_other(speed=0.0), 'diameter', 'roller', 'tachometer'),
    'dead encoder': (_other(roller=0.0), 'encoder', 'roller', 'its cable'),
}


@pytest.fixture
def check(tmp_path: Path) -> Callable[[Record], tuple[int, dict[tuple[str, str], dict]]]:
    rig = tmp_path / 'rig.yaml'
    rig.write_text(
        f'/**: {{ros__parameters: {{roller_diameter_m: {DIAMETER_M}, flange_clearance_m: 0.008,'
        ' lateral_range_m: 0.01}}}'.replace('}}}', '}}')
    )

    def run(record: Record) -> tuple[int, dict[tuple[str, str], dict]]:
        bag, out = tmp_path / 'bag', tmp_path / 'found.json'
        write_record(bag, record)
        code = main(['check', str(bag), '--rig', str(rig), '--json', str(out)])
        found = json.loads(out.read_text())
        assert found['failed'] == sum(one['state'] == 'fail' for one in found['checks'])
        assert code == (1 if found['failed'] else 0)
        return code, {(one['check'], one['channel']): one for one in found['checks']}

    return run


def test_a_sound_rig_passes_with_the_numbers_that_it_has(check) -> None:
    code, found = check(_sound())
    assert code == 0
    assert {one['state'] for one in found.values()} == {'ok'}
    assert not any('e-0' in one['text'] for one in found.values())
    assert found['rate', 'lateral']['value'] == pytest.approx(RATE_HZ)
    # The motion itself adds to a noise told by second differences: 3 % here.
    assert found['noise', 'lateral']['value'] == pytest.approx(NOISE_M, rel=0.1)
    assert found['resolution', 'lateral']['value'] == pytest.approx(1e-6)
    assert found['diameter', 'roller']['value'] == pytest.approx(DIAMETER_M, rel=1e-3)
    assert found['encoder', 'roller']['value'] == pytest.approx(2.0 * 7.0 / DIAMETER_M)
    assert abs(found['filter', '']['value']) < 0.03


@pytest.mark.parametrize('fault', FAULTS)
def test_a_fault_is_found_and_says_what_to_do(check, fault: str) -> None:
    change, what, channel, words = FAULTS[fault]
    _, found = check(change(_sound()))
    one = found[what, channel]
    state = {'standing': 'unknown', 'coarse': 'warn'}.get(fault, 'fail')
    assert one['state'] == state, one
    assert words in one['advice'], one
    assert all(one['advice'] for one in found.values() if one['state'] != 'ok')
    # An angle that is read too seldom tells no diameter.
    assert what != 'encoder' or ('diameter', 'roller') not in found


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        (lambda v: np.clip(v, -6e-5, 6e-5), 'saturated at 6e-05 and -6e-05'),
        (lambda v: np.where(np.arange(v.size) % 400 == 200, -9.999, v), '5 spikes'),
    ],
)
def test_a_range_that_nobody_stated_and_error_codes_are_seen(check, values, words: str) -> None:
    """Both were all ok here, while `hunt identify` left most of the recording out."""
    _, found = check(changed(_sound(), lateral=values))
    one = found['range', 'lateral']
    assert one['state'] in ('warn', 'fail')
    assert words in one['text']


@pytest.mark.parametrize('channel', ['lateral', 'yaw', 'roller', 'speed'])
@pytest.mark.parametrize('size', [-1e300, 1e4])
def test_a_reading_that_no_sensor_gives_is_found_and_none_to_any_command(
    check, tmp_path, capsys, channel: str, size: float
) -> None:
    sound, value = _sound(), size * LARGEST[channel][0]
    values = sound[channel].values.copy()
    values[700] = value
    _, found = check(changed(sound, **{channel: values}))
    if channel == 'roller' and size > 0.0:  # an angle may be of any size
        return
    told = f'channel {channel}: 1 readings of up to {abs(value):.3g} (SI) are none of a sensor'
    assert told in found['damage', '']['text']
    assert found['gaps', channel]['text'] == '1 readings are no numbers'
    bag, json = str(tmp_path / 'bag'), str(tmp_path / 'told.json')
    for verb, code in {'replay': 0, 'identify': 1, 'info': 1}.items():  # of one speed only
        assert main([verb, bag, '--json', json]) == code
        assert told in Path(json).read_text()


@pytest.mark.parametrize('size', [0.02, 5.0])
def test_a_sensor_that_spikes_once_is_neither_dead_nor_coarse(check, size: float) -> None:
    values = _sound()['lateral'].values.copy()
    values[700] = size
    _, found = check(changed(_sound(), lateral=values))
    assert ('motion', 'lateral') not in found
    assert found['resolution', 'lateral']['value'] == pytest.approx(1e-6)
    assert found['noise', 'lateral']['value'] == pytest.approx(NOISE_M, rel=0.1)
    assert abs(found['filter', '']['value']) < 0.03
    assert found['range', 'lateral']['text'] == 'has 1 spike of one sample'


def test_of_live_topics_an_impossible_reading_advises_no_recording(monkeypatch, tmp_path) -> None:
    def told(name: str, series: Series) -> dict[str, object]:
        values = series.values.tolist()
        if name == 'lateral':
            values[700] = 1e4
        stamps = series.stamps_ns.tolist()
        one = {'values': values, 'stamps_ns': stamps, 'arrivals_ns': stamps}
        return one | {'publishers': ['/rig/a'], 'topic': f'/rig/{name}'}

    heard = {name: told(name, series) for name, series in _sound().items()}
    monkeypatch.setattr(check_verb, 'ask', lambda spec, namespace: heard)
    out = tmp_path / 'found.json'
    main(['check', '--directory', str(tmp_path), '--json', str(out)])
    found = json.loads(out.read_text())['checks']
    (damage,) = (one for one in found if one['check'] == 'damage')
    assert '1 readings of up to 1e+04' in damage['text']
    assert 'its cable' in damage['advice']
    assert not any('hunt info' in one['advice'] for one in found)


@pytest.mark.parametrize('lost', [np.nan, np.inf])
def test_a_speed_that_is_no_number_tells_no_diameter(check, lost) -> None:
    code, found = check(changed(_sound(), speed=lost))
    assert code == 1
    assert found['gaps', 'speed']['state'] == 'fail'
    assert ('diameter', 'roller') not in found
    assert ('speed', 'speed') not in found


def test_an_encoder_may_wrap_and_run_backwards(check) -> None:
    code, found = check(changed(_sound(), roller=lambda v: -v % (2.0 * np.pi)))
    assert code == 0
    text = found['encoder', 'roller']['text']
    assert 'backwards' in text
    assert 'wraps' in text


def test_what_turned_in_a_gap_does_not_change_the_diameter(check) -> None:
    sound = _sound()
    kept = np.arange(1000) // 200 != 2
    holed = {
        n: Series(sound[n].stamps_ns[kept], sound[n].values[kept]) for n in ('roller', 'speed')
    }
    _, found = check(changed(sound, **holed))
    assert found['gaps', 'roller']['state'] == 'fail'
    assert found['diameter', 'roller']['value'] == pytest.approx(DIAMETER_M, rel=1e-3)


def test_an_encoder_that_comes_twice_tells_the_diameter_too(check) -> None:
    roller = _sound()['roller']
    twice = Series(np.repeat(roller.stamps_ns, 2), np.repeat(roller.values, 2))
    _, found = check(changed(_sound(), roller=twice))
    assert found['diameter', 'roller']['value'] == pytest.approx(DIAMETER_M, rel=1e-3)


@pytest.mark.parametrize('back', [700, 500])
def test_a_run_that_reverses_does_not_change_the_diameter(check, back: int) -> None:
    way = np.where(np.arange(1000) < back, 1.0, -1.0)
    angle = np.cumsum(way) * 2.0 * 7.0 / DIAMETER_M * 0.01
    _, found = check(changed(_sound(), speed=7.0 * way, roller=angle))
    assert 'both ways at 34.9' in found['encoder', 'roller']['text']
    assert found['diameter', 'roller']['value'] == pytest.approx(DIAMETER_M, rel=1e-2)


@pytest.mark.parametrize('turning', [-1.0, 1.0])
def test_a_run_in_reverse_is_said_and_no_fault(check, turning: float) -> None:
    """The numbers cannot tell a reverse run from a wrong sign; the detector warns of both."""
    code, found = check(changed(_sound(), speed=lambda v: -v, roller=lambda v: turning * v))
    assert code == 0
    assert found['speed', 'speed']['state'] == 'warn'
    assert '-7.000 m/s on average: the rig runs in reverse' in found['speed', 'speed']['text']
    assert 'where it does not' in found['speed', 'speed']['advice']


def test_a_person_reads_a_line_a_check(check, tmp_path, capsys) -> None:
    check(_sound())
    assert main(['check', str(tmp_path / 'bag')]) == 0
    out = capsys.readouterr().out
    assert 'lateral rate         200 samples/s' in out
    assert 'roller_diameter_m: 0.4' in out, 'without a rig file the diameter is offered'


@pytest.mark.parametrize('lost', ['speed', 'lateral'])
def test_what_no_rig_can_do_without_fails_also_without_a_rig_file(tmp_path, capsys, lost) -> None:
    others = ['yaw'] if lost == 'lateral' else []
    bag = write_record(tmp_path / 'bag', without(_sound(), lost, *others))
    assert main(['check', str(bag)]) == 1
    (line,) = (x for x in capsys.readouterr().out.splitlines() if x.startswith('fail'))
    assert line.split()[1] == lost
