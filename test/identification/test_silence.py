"""Bad input: a refusal in one line, or a result in which every null has its reason."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
from made import SECOND, changed, numbers

from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.errors import HuntError
from hunt_ros.identification import identify
from hunt_ros.identification.result import lines_of, reason_in
from hunt_ros.identification.verdict.reasons import nulls_of, unknown_of
from hunt_ros.samples import Record, Series

OTHER = NormalForm(8.0, 0.12, 900.0, -0.06, 1900.0, -7e6, frequency_hz=4.4)


def held(make, speeds, seconds=40.0, kick=1e-4, **kwargs):
    kicks = [(5.0, kick)]
    return [
        make(v, seconds, 10 + i, forcing=5e-6, kicks=kicks, **kwargs) for i, v in enumerate(speeds)
    ]


def next_day(stamps_ns):
    return stamps_ns + 86_400 * SECOND


def quiet_start(t):
    return np.where(t < 40.0, 0.0, 5.8 + 0.02 * (t - 40.0))


def restamped(record, change, source):
    """The same record with other stamps, a function of the old ones."""
    return Record({k: Series(change(s.stamps_ns), s.values) for k, s in record.items()}, source)


def paused(record, days):
    """The same record, its second half so many days later."""
    middle, pause = (record.start_ns + record.end_ns) // 2, days * 86_400 * SECOND
    return restamped(record, lambda ns: ns + pause * (ns > middle), record.source)


def dies_at_a_stop(record):
    """The rig stops in the middle for ten seconds, and from then on the sensor reads nothing."""
    lateral, speed = record['lateral'], record['speed']
    middle = (record.start_ns + record.end_ns) // 2
    stands = (speed.stamps_ns > middle) & (speed.stamps_ns < middle + 10_000_000_000)
    gone = np.where(lateral.stamps_ns > middle, np.nan, lateral.values)
    return changed(record, lateral=gone, speed=np.where(stands, 0.0, speed.values))


def lateral(change):
    """Make a case: the loop with other lateral readings, a function of the old ones."""
    return lambda make, loop, stairs: [changed(loop, lateral=change)]


def speed(change):
    """Make a case: the loop with other readings of the speed."""
    return lambda make, loop, stairs: [changed(loop, speed=change)]


#: Name -> records from what makes them, a sweep and a staircase; each one a thing that a lab has
#: handed in by mistake.
CASES = {
    'one speed only': lambda make, loop, stairs: held(make, [7.2], 120.0),
    'one speed only, two runs': lambda make, loop, stairs: held(make, [7.2, 7.2]),
    'only decays': lambda make, loop, stairs: held(make, [6.4, 6.8, 7.2, 7.5, 6.6, 7.0]),
    'only the upper branch': lambda make, loop, stairs: [
        make(lambda t: 8.8 - 0.01 * t, 150.0, 2, start=7e-4)
    ],
    'hysteresis from above only': lambda make, loop, stairs: [
        make(lambda t: 8.8 - 0.01 * t, 320.0, 7, start=7e-4, forcing=5e-6)
    ],
    'never hunts': lambda make, loop, stairs: [
        make(lambda t: 5.5 + 0.01 * t, 150.0, 3, forcing=5e-6)
    ],
    'never hunts, no noise': lambda make, loop, stairs: [
        make(lambda t: 5.5 + 0.01 * t, 150.0, 3, noise=0.0)
    ],
    'ten samples': lambda make, loop, stairs: [
        Record({k: Series(s.stamps_ns[:10], s.values[:10]) for k, s in loop.items()}, 'ten')
    ],
    'five seconds': lambda make, loop, stairs: [make(7.0, 5.0, 4, forcing=5e-6)],
    'contradictory runs': lambda make, loop, stairs: [
        loop,
        restamped(changed(loop, lateral=lambda y: 1.4 * y), next_day, 'louder'),
    ],
    'dropped out': lateral(lambda y: np.nan),
    'nine of ten dropped out': lateral(lambda y: np.where(np.arange(y.size) % 10, np.nan, y)),
    'a pause of 60 days': lambda make, loop, stairs: [paused(loop, 60)],
    'dies at a stop': lambda make, loop, stairs: [dies_at_a_stop(loop)],
    'long gaps': lateral(lambda y: np.where(np.arange(y.size) % 4000 < 3600, np.nan, y)),
    'speed zero': speed(lambda v: 0.0),
    'speed NaN': speed(lambda v: np.nan),
    'speed of infinity': speed(lambda v: np.inf),
    'stands at first': lambda make, loop, stairs: [make(quiet_start, 180.0, 5, forcing=5e-6)],
    'constant lateral': lateral(lambda y: 1e-4),
    'lateral zero': lateral(lambda y: -0.0),
    'millimetres as metres': lateral(lambda y: 1e3 * y),
    'metres as millimetres': lateral(lambda y: 1e-3 * y),
    'speed in mm/s': speed(lambda v: 1e3 * v),
    'a channel that blows up': lateral(lambda y: y * np.exp(0.005 * np.arange(y.size))),
    'second speed in km/h': lambda make, loop, stairs: [
        loop,
        changed(stairs, speed=lambda v: 3.6 * v),
    ],
    'lateral of infinities': lateral(lambda y: np.where(np.arange(y.size) % 50, y, np.inf)),
    'yaw only': lambda make, loop, stairs: [
        Record({'yaw': loop['lateral'], 'speed': loop['speed']}, 'yaw only')
    ],
    'no speed': lambda make, loop, stairs: [Record({'lateral': loop['lateral']}, 'no speed')],
    'given twice': lambda make, loop, stairs: [loop, loop],
    'noise only': lateral(lambda y: np.random.default_rng(0).normal(0.0, 1e-5, y.size)),
    'stamps all equal': lambda make, loop, stairs: [
        restamped(loop, lambda ns: np.full_like(ns, 7), 'eq')
    ],
    'stamps in reverse': lambda make, loop, stairs: [
        restamped(loop, lambda ns: ns[::-1], 'reverse')
    ],
    'an empty record': lambda make, loop, stairs: [Record({}, 'empty')],
    'no record': lambda make, loop, stairs: [],
    'runs of two rigs': lambda make, loop, stairs: [
        *held(make, [8.6], kick=3e-4),
        *held(make, [8.7], kick=3e-4, form=OTHER),
    ],
}


@pytest.fixture(scope='module')
def outcome(make, records):
    """Name -> the document, or the refusal; each worked out once."""
    known, loop, stairs = {}, records['sweep'][0], records['staircase'][0]

    def work(name):
        if name not in known:
            try:
                known[name] = identify(CASES[name](make, loop, stairs)).to_json()
            except HuntError as error:
                known[name] = error
        return known[name]

    return work


@pytest.mark.slow
@pytest.mark.parametrize('name', CASES)
def test_bad_input_is_refused_in_a_line_or_every_null_has_its_reason(outcome, name):
    document = outcome(name)
    if isinstance(document, HuntError):
        assert '\n' not in str(document)
        assert len(str(document)) > 20
        return
    json.dumps(document, allow_nan=False)
    assert all(math.isfinite(number) for number in numbers(document))
    for key in nulls_of(document):
        reason = document['unknown'].get(key)
        assert reason, f'{key} is null, and nothing says why'
        assert any(key in line and line.endswith(reason) for line in document['warnings'])
        assert reason != 'the data do not show it', key


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('ten samples', 'ten: 10 lateral samples'),
        ('dropped out', 'no finite sample'),
        ('nine of ten dropped out', 'drop-outs'),
        ('speed zero', '0.00 m/s while the encoder turns'),
        ('speed NaN', "'speed' has no finite sample"),
        ('constant lateral', 'lateral is 0.0001 m throughout'),
        ('lateral zero', 'lateral is 0 m throughout'),
        ('yaw only', "no channel 'lateral'"),
        ('no speed', "no channel 'speed'"),
        ('noise only', 'no hunting motion stands out'),
        ('stamps all equal', 'too few'),
        ('no record', 'none of 0'),
        ('a channel that blows up', 'no displacement of a wheelset'),
    ],
)
def test_what_cannot_be_used_is_refused_by_its_own_name(outcome, name, words):
    assert words in str(outcome(name))
    assert isinstance(outcome(name), HuntError)


@pytest.mark.parametrize(
    'name',
    [
        'one speed only', 'one speed only, two runs', 'only decays', 'only the upper branch',
        'never hunts', 'never hunts, no noise', 'five seconds', 'contradictory runs',
        'runs of two rigs',
    ],
)  # fmt: skip
def test_no_coefficient_and_no_fold_without_support(outcome, name):
    document = outcome(name)
    assert document['v_n'] is None
    assert document['hysteresis_width'] is None
    assert document['coefficients']['D15'] is None
    assert document['normal_form'] is None
    assert document['branches'] == []


@pytest.mark.parametrize('name', ['one speed only', 'one speed only, two runs'])
def test_that_there_is_one_speed_only_comes_before_other_reasons(outcome, name):
    unknown = outcome(name)['unknown']
    for key in ('v_c', 'v_n', 'hysteresis_width', 'supercritical_probability', 'normal_form'):
        assert unknown[key].startswith('one speed only'), key


@pytest.mark.parametrize(
    'name',
    ['millimetres as metres', 'metres as millimetres', 'speed in mm/s', 'second speed in km/h'],
)
def test_a_wrong_unit_is_doubted(outcome, name):
    assert any('is the unit right?' in warning for warning in outcome(name)['warnings'])


def test_the_right_unit_is_not_doubted(outcome, records):
    for name in ('given twice', 'never hunts', 'only decays'):
        assert not any('unit' in warning for warning in outcome(name)['warnings'])


def test_data_that_are_given_twice_in_part_count_once(records, identified):
    """A copy with another last bit, or cuts that overlap, made intervals narrower by a third."""
    loop = records['sweep'][0]
    lateral = loop['lateral']
    values = lateral.values.copy()
    values[100] += 1e-9
    copy = Record({**loop, 'lateral': Series(lateral.stamps_ns, values)}, 'copy')
    once, twice = identified('sweep'), identify([loop, copy])
    assert any('left out: copy: the same samples' in line for line in twice.notices)
    assert twice.v_n == once.v_n
    start, length = loop.start_ns, loop.end_ns - loop.start_ns
    first = loop.between(start, start + int(0.7 * length))
    last = loop.between(start + int(0.3 * length), loop.end_ns)
    cuts = identify([first, Record(dict(last), 'last')])
    assert any(line.startswith('left out: last from 0 to ') for line in cuts.notices)
    counts = [np.isfinite(one.amplitude).sum() for one in cuts.envelopes]
    assert sum(counts) <= np.isfinite(once.envelopes[0].amplitude).sum()
    # A clip that comes first cuts nothing out of its recording.
    clip = Record(dict(loop.between(start, start + int(0.2 * length))), 'clip')
    clipped = identify([clip, loop])
    assert any('left out: clip: the same samples' in line for line in clipped.notices)
    assert clipped.v_n == once.v_n


def test_too_few_samples_a_cycle_are_no_drop_outs(records):
    loop = records['sweep'][0]
    lateral = loop['lateral']
    few = Series(lateral.stamps_ns[::28], lateral.values[::28])
    with pytest.raises(HuntError, match=r'7.14 samples a second are too few .* expected 9'):
        identify(Record({**loop, 'lateral': few}, loop.source))


def test_recordings_that_name_different_rigs_are_refused(records):
    loop = records['sweep'][0]
    other = Record(dict(loop), 'b', {'rig': 'north'})
    with pytest.raises(HuntError, match=r"different rigs: 'south' in a and 'north' in b"):
        identify([Record(dict(loop), 'a', {'rig': 'south'}), other])


def test_standing_still_first_does_not_spoil_the_run_after_it(outcome):
    document = outcome('stands at first')
    assert document['v_c']['value'] == pytest.approx(8.0, abs=0.3)
    assert min(state['speed_mps'] for state in document['steady_states']) > 5.0


def test_what_comes_after_a_pause_of_weeks_counts_as_what_was_before(outcome):
    document = outcome('a pause of 60 days')
    assert document['v_c']['value'] == pytest.approx(8.0, abs=0.2)
    assert document['v_n']['value'] == pytest.approx(6.43, abs=0.1)


def test_damage_that_opening_showed_is_in_the_warnings(records):
    loop = records['sweep'][0]
    damaged = Record(dict(loop), 'cut', {'problems': 'the file ends in the middle of a chunk'})
    warnings = identify([damaged]).to_json()['warnings']
    assert 'cut: damaged: the file ends in the middle of a chunk' in warnings


def test_every_null_is_named_once_and_the_longest_reason_counts():
    document = {'a': None, 'b': {'c': None, 'd': 1.0}, 'branches': [], 'list': [{'x': None}] * 3}
    unknown = unknown_of(document, {'a': 'one', 'b': 'other', 'b.c': 'one', 'list': 'two'})
    assert lines_of(unknown) == [
        'branches not known: at some speeds the law has no such limit cycle',
        'a, b.c not known: one',
        'list.x not known: two',
    ]
    assert reason_in(unknown, 'list.2.x') == 'two'
    assert reason_in(unknown, 'a.ci95') == 'one'
    assert reason_in(unknown, 'b.d') == ''


#: Reasons that lie in what a quantity is: no document can refute them.
SELF_EVIDENT = (
    'at some speeds the law has no such', 'some steady states are too short',
    'the mean of the maxima is taken', 'some of the free motion was small',
    'on some day or on any',
    'too few of the laws', 'kicks bound it on one side', 'a hysteresis without end',
)  # fmt: skip


def _moved(document):
    events = document['bracket']['events']
    return [e for e in events if e['kind'] in ('grew', 'died') or e['kick_m'] is not None]


def _below_zero(document, name):
    number = document['coefficients'][name]
    return number is not None and number['ci95'][1] < 0.0


#: What a reason claims, and how the document it stands in shows that. Reasons that speak of the
#: draws alone, which a document does not hold, claim nothing here.
CLAIMS = (
    (r'nothing ends the growth at v_c', lambda d: not _below_zero(d, 'D15')),
    (r'^all amplitudes are of one kind', lambda d: d['observed']['v_c'] is None),
    (r'no free transient', lambda d: not _moved(d)),
    (r'one speed only', lambda d: np.ptp(d['effective']['speeds_mps']) < 0.2),
    (r'a jump up, speed rising', lambda d: d['observed']['v_c'] is None),
    (r'a jump up and a jump down', lambda d: d['observed']['hysteresis_width'] is None),
    (r'a jump down, speed falling', lambda d: d['observed']['v_n'] is None),
    (r'the linear growth rate nowhere rises through zero', lambda d: d['v_c'] is None),
    (r'^v_c is not determined|^v_c would', lambda d: d['v_c'] is None),
    (r'D4 is not determined', lambda d: d['coefficients']['D4'] is None),
    (r'a supercritical rig has no fold', lambda d: d['criticality'] == 'supercritical'),
    (r'the rig is subcritical: it has', lambda d: d['criticality'] == 'subcritical'),
    (r'^lack of fit|has not converged|contradict|another way|falls through zero again',
     lambda d: d['fit']['lack_of_fit']),
    (r'needs v_c and D1 of a normal form', lambda d: d['normal_form'] is None),
    (r'no normal form is given', lambda d: d['normal_form'] is None),
    (r'no fold of the law lies near', lambda d: d['v_n'] is None),
    (r'too short: fewer than a few dozen', lambda d: d['v_c'] is None),
    (r'D1 cannot be known', lambda d: d['coefficients']['D1'] is None),
    (r'the unstable branch does not reach', lambda d: d['disturbance_m'] is None),
    (r'small motion was seen', lambda d: d['v_c'] is None),
    (r'no settled limit cycle near|recipe needs four limit cycles',
     lambda d: d['four_point'] is None),
    (r'rose and fell at speeds \d', lambda d: d['observed']['v_n'] is None),
    (r'fell at a higher speed than it rose', lambda d: d['observed']['v_n'] is None),
    (r'rest and a limit cycle were not seen', lambda d: d['bracket']['coexistence_mps'] is None),
    (r'rest and a limit cycle cannot be told', lambda d: not d['bracket']['events']),
    (r'no motion as large as a limit cycle',
     lambda d: None in d['bracket']['cycle_ends_between_mps']),
    (r'long enough to show its damping', lambda d: d['bracket']['v_c_above_mps'] is None),
    (r'only rest has one', lambda d: any(e['kind'] != 'rest' for e in d['bracket']['events'])),
    (r'only rest was seen, which',
     lambda d: all(e['kind'] == 'rest' for e in d['bracket']['events'])),
    (r'are rest or a limit cycle cannot be told', lambda d: not d['bracket']['events']),
    (r'nothing grew out of rest unkicked', lambda d: d['bracket']['began_mps'] is None),
    (r'not every motion was kicked',
     lambda d: any(e['kick_m'] is None for e in d['bracket']['events'])),
    (r'no stretch holds its amplitude', lambda d: not d['steady_states']),
    (r'nothing bounds that side', lambda d: None in d['bracket']['v_n_between_mps']),
    (r'by the law both may not last', lambda d: d['bracket']['coexistence_mps'] is None),
    (r'its amplitude falls without a jump', lambda d: d['criticality'] == 'supercritical'),
    (r'no fold, against what was seen', lambda d: d['criticality'] == 'subcritical'),
    (r'no jump was observed', lambda d: d['observed']['step_mps'] is None),
    (r'no motion shows whether the law holds', lambda d: d['fit']['lack_of_fit_p'] is None),
)  # fmt: skip


def refuted(document):
    """Reasons that the document itself refutes, and reasons of which nobody knows the claim."""
    wrong, unread = [], []
    for key, reason in document['unknown'].items():
        claims = [holds for pattern, holds in CLAIMS if re.search(pattern, reason)]
        wrong += [(key, reason) for holds in claims if not holds(document)]
        if not claims and not any(words in reason for words in SELF_EVIDENT):
            unread.append((key, reason))
    return wrong, unread


@pytest.mark.slow
@pytest.mark.parametrize('name', CASES)
def test_no_reason_is_refuted_by_the_document_it_stands_in(outcome, name):
    document = outcome(name)
    if not isinstance(document, HuntError):
        assert refuted(document) == ([], [])
