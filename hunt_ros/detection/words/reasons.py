"""Why the level is what it is, and why something changed, in words for an operator."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts
from hunt_ros.detection.channels import health
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import states
from hunt_ros.detection.decision.decisions import MARGIN_BACK
from hunt_ros.detection.decision.limits import LIMITS, limit_cause
from hunt_ros.detection.regions import Region, State
from hunt_ros.samples import CHANNELS, Uncertain

_HUNTING = {State.ESCAPING: 'escaping from the quiet state', State.LIMIT_CYCLE: 'limit cycle'}
#: A shorter time to the limit cycle is not told: it is there, as far as one can tell, s.
_SOON_S = 0.1
_LIMIT_BITS = [
    (1 << number, f'{limit.what} above its {limit.severity} limit')
    for number, limit in enumerate(LIMITS)
]


@dataclass(frozen=True)
class Basis:
    """
    What the numbers of a row were compared with.

    Parameters
    ----------
    config : DetectorConfig
    v_n, v_c : float
        Boundaries of the regions, m/s; NaN: none, unknown.
    normal_form : str
        By its critical speeds; '' where there is none.
    fold_amplitude : float
        Of the limit cycle at v_n, m; NaN where no form gives it.
    frequency_hz : float
        Of the hunting, by the form, Hz; NaN without one.
    """

    config: DetectorConfig
    v_n: float = math.nan
    v_c: float = math.nan
    normal_form: str = ''
    fold_amplitude: float = math.nan
    frequency_hz: float = math.nan


def reasons_of(row: np.void, basis: Basis, decided: str = '') -> tuple[str, ...]:
    """
    Put a row of the estimates into words.

    Parameters
    ----------
    row : void of ESTIMATE_DTYPE
        One row.
    basis : Basis
        What its numbers were compared with.
    decided : str
        Why the state was said, with the numbers there were then.

    Returns
    -------
    tuple of str
        The most serious first; empty where all is well.
    """
    found = [*channel_reasons(row, health.SEVERE)]
    state = State(int(row['state']))
    lasted = 1e-9 * (int(row['stamp_ns']) - int(row['state_since_ns']))
    # Where a clock was set back, the state began on the one before.
    lasting = f' for {lasted:.1f} s' if lasted >= 0.0 else ''
    why = f'{lasting}: {decided}' if decided else ''
    if state in _HUNTING:
        words = _HUNTING[state] + why
        time = float(row['time_to_limit_cycle'])
        if state is State.ESCAPING and time >= _SOON_S:
            words += f', limit cycle in about {time:.1f} s'
        found.append(words)
    for number, (bit, words) in reversed(list(enumerate(_LIMIT_BITS))):  # alarms first
        if int(row['limits']) & bit:
            found.append(f'{words}: {limit_cause(row, number, basis.config)}')
    for bit, words, numbers in _DOUBTS:
        if int(row['doubts']) & bit:
            told = why if bit == doubts.DECAYING else ''
            found.append(words + told if numbers is None else f'{words}: {numbers(row, basis)}')
    return (*found, *channel_reasons(row, health.MILD))


def absent_words(row: np.void) -> tuple[str, ...]:
    """Return which optional channels are absent in a row, and what that costs."""
    gone = [name for name in CHANNELS if int(row[f'{name}_wrong']) & health.ABSENT]
    return tuple(f'{name} is absent: {health.COSTS[name]}' for name in gone)


def _measured(value: float, std: float, unit: str) -> str:
    """Return a number with its deviation, to the digits that this gives sense to."""
    if math.isnan(value):
        return 'unknown'
    number = Uncertain(value, std).text(' +/- ') if math.isfinite(std) else f'{value:.3g}'
    return f'{number} {unit}'


def _growth(row: np.void) -> str:
    return _measured(float(row['growth_rate']), float(row['growth_rate_std']), '1/s')


def _unstable(row: np.void) -> str:
    edge, std = 1e3 * float(row['unstable_amplitude']), 1e3 * float(row['unstable_amplitude_std'])
    return f'unstable amplitude {_measured(edge, std or math.nan, "mm")}'


def _size(row: np.void) -> str:
    """Return the amplitude that is judged, with its deviation."""
    in_yaw = bool(int(row['doubts']) & doubts.IN_YAW)
    name, unit = ('yaw', 'mrad') if in_yaw else ('lateral', 'mm')
    a, s = 1e3 * float(row[f'{name}_amplitude']), 1e3 * float(row[f'{name}_amplitude_std'])
    return f'amplitude {_measured(a, s, unit)}'


def _chance(row: np.void) -> str:
    """Return the probability of ending on the limit cycle, with its interval."""
    value, low, high = (
        100.0 * float(row[f'escape_probability{end}']) for end in ('', '_low', '_high')
    )
    interval = f' ({low:.0f} to {high:.0f} %)' if f'{low:.0f}' != f'{high:.0f}' else ''
    return f'{value:.0f} %{interval}'


def _floor(row: np.void) -> str:
    in_yaw = bool(int(row['doubts']) & doubts.IN_YAW)
    floor = 1e3 * float(row['noise_floor'])
    return f'quiet amplitude {_measured(floor, math.nan, "mrad" if in_yaw else "mm")}'


def _ratio(row: np.void) -> str:
    ratio, limit = float(row['log_likelihood_ratio']), float(row['log_likelihood_ratio_limit'])
    return f'log likelihood ratio {ratio:.3g}, limit {limit:.3g}'


def state_cause(row: np.void, basis: Basis) -> tuple[str, str]:
    """Return which test led to the state of a row, and its evidence with its numbers."""
    size, growth, chance = f'the {_size(row)}', _growth(row), _chance(row)
    config = basis.config
    edge = ''
    if math.isfinite(row['unstable_amplitude']):
        edge = f', {_unstable(row)}'
    elif int(row['region']) == Region.UNSTABLE and not int(row['doubts']) & doubts.IN_YAW:
        edge = ', the quiet state is unstable at this speed'
    stable = 1e3 * float(row['stable_amplitude'])
    words = {
        states.BEYOND: (
            'escape_probability',
            f'{size} ends on the limit cycle with a probability of {chance},'
            f' limit {100.0 * config.escape_probability_in:g} %{edge}; growth rate {growth}',
        ),
        states.ARRIVED: (
            'stable_amplitude',
            f'{size} has reached the limit cycle'
            + (f' of {stable:.3g} mm' if math.isfinite(stable) else '')
            + f'{edge}; growth rate {growth}',
        ),
        states.STEADY: (
            'likelihood_ratio',
            f'{size} stays as that of a limit cycle does: {_ratio(row)}; growth rate {growth},'
            f' {_floor(row)}',
        ),
        states.GROWING: (
            'likelihood_ratio',
            f'{size} grows for sure: {_ratio(row)}; growth rate {growth}, {_floor(row)}',
        ),
        states.COMES_BACK: (
            'escape_probability',
            f'{size} ends on the limit cycle with a probability of {chance} only{edge};'
            f' growth rate {growth}',
        ),
        states.FALLS: (
            'likelihood_ratio',
            f'{size} falls for sure: {_ratio(row)}; growth rate {growth}{edge}',
        ),
        states.OVER: (
            'noise_floor',
            f'{size} is that of the quiet motion again: {_floor(row)}',
        ),
    }
    return words.get(int(row['state_cause']), ('amplitude', size))


def region_cause(row: np.void, basis: Basis) -> str:
    """Say where the speed of a row lies."""
    v_n, v_c = basis.v_n, basis.v_c
    speed = float(row['speed'])
    if math.isnan(speed):
        return 'the speed is not known'
    fold = f'v_n = {v_n:.3f} m/s' if v_n > 0.0 else 'the fold, which is not known'
    edge = 1e3 * float(row['unstable_amplitude'])
    starts = f', {_unstable(row)}' if math.isfinite(edge) else ''
    words = {
        Region.STABLE: f'is below {fold if math.isfinite(v_n) else f"v_c = {v_c:.3f} m/s"}',
        Region.HYSTERESIS: f'lies between {fold} and v_c = {v_c:.3f} m/s{starts}',
        Region.UNSTABLE: f'is above v_c = {v_c:.3f} m/s',
    }
    region = Region(int(row['region']))
    return f'the speed {speed:.3f} m/s ' + words.get(region, 'has no known boundaries')


def margin_cause(row: np.void, basis: Basis) -> str:
    """Compare the margin of a row with its limit."""
    low = bool(int(row['doubts']) & doubts.MARGIN)
    limit = basis.config.margin_in * (1.0 if low else MARGIN_BACK)
    margin = float(row['margin'])
    if not math.isfinite(margin):
        if int(row['region']) == Region.UNSTABLE:
            return 'quiet motion is unstable at this speed'
        gone = 'quiet motion of any amplitude is stable at this speed'
        return f'{gone}, but it is not quiet yet' if low else gone
    least, most = float(row['margin_low']), float(row['margin_high'])
    interval = f'{least:.3g} to {most:.3g}' if math.isfinite(most) else f'at least {least:.3g}'
    return (
        f'unstable amplitude over amplitude is {margin:.3g} ({interval}),'
        f' limit {limit:g}; {_unstable(row)}, {_size(row)}'
    )


def _two_amplitudes(row: np.void, _: Basis) -> str:
    """Return both estimates of the amplitude, for each sensor that has both."""
    found = []
    for name, unit in (('lateral', 'mm'), ('yaw', 'mrad')):
        amplitude, envelope = (
            1e3 * float(row[f'{name}_amplitude']),
            1e3 * float(row[f'{name}_envelope']),
        )
        if math.isfinite(amplitude + envelope):
            found.append(f'{name} {amplitude:.3g} and {envelope:.3g} {unit}')
    return ', '.join(found)


def _spread(row: np.void, _: Basis) -> str:
    spread = float(row['lateral_amplitude_std']) / float(row['lateral_amplitude'])
    return f'+/- {100.0 * spread:.0f} %'


def _two_frequencies(row: np.void, basis: Basis) -> str:
    """Return the frequency of the motion, and that of the hunting by the form."""
    std = float(row['frequency_hz_std'])
    return (
        f'{_size(row)} at {_measured(float(row["frequency_hz"]), std, "Hz")}, the normal form has'
        f' {basis.frequency_hz:.3g} Hz'
        + (f' and {1e3 * basis.fold_amplitude:.3g} mm' if basis.fold_amplitude > 0.0 else '')
    )


def reason_counts(rows: NDArray[np.void]) -> Counter[str]:
    """
    Count the rows that each reason made WARN or worse, without its numbers.

    Parameters
    ----------
    rows : ndarray of ESTIMATE_DTYPE, shape (m,)
        Any rows.

    Returns
    -------
    Counter of str
    """
    counts: Counter[str] = Counter()
    columns = [(rows['doubts'], '', tuple((bit, words) for bit, words, _ in _DOUBTS))]
    channel_words = tuple(health.WORDS.items())
    columns.append((rows['limits'], '', tuple(_LIMIT_BITS)))
    columns += [(rows[f'{name}_wrong'], f'{name}: ', channel_words) for name in CHANNELS]
    for column, prefix, table in columns:
        present = int(np.bitwise_or.reduce(column)) if column.size else 0
        for bits, words in table:
            if present & bits:
                counts[prefix + words] += int(np.count_nonzero(column & np.uint32(bits)))
    for state in (State.ESCAPING, State.LIMIT_CYCLE):
        count = int(np.count_nonzero(rows['state'] == state))
        if count:
            counts[_HUNTING[state]] += count
    return counts


def outside_words(row: np.void) -> str:
    """Say of a row with motion that is not followed what it is, and what to do."""
    lateral, yaw = float(row['outside_lateral']), float(row['outside_yaw'])
    if math.isfinite(lateral):
        motion = f'a motion of {1e3 * lateral:.2g} mm'
    else:
        motion = f'a yaw motion of {1e3 * yaw:.2g} mrad'
    low, high = float(row['followed_min_hz']), float(row['followed_max_hz'])
    hz = float(row['outside_hz'])
    if low <= hz <= high:
        where = f'is not what the filter follows at {float(row["frequency_hz"]):.2g} Hz'
    else:
        where = (
            f'lies outside the hunting frequencies {low:.3g} to {high:.3g} Hz that are followed'
        )
    return f'{motion} at {hz:.2g} Hz {where}: set hunting_frequency_hz if it is hunting'


def channel_reasons(row: np.void, among: int) -> list[str]:
    """Return what is wrong with the channels in a row, as 'channel: words'."""
    found = []
    for channel in CHANNELS:
        wrong = int(row[f'{channel}_wrong']) & among
        found += [f'{channel}: {words}' for bit, words in health.WORDS.items() if wrong & bit]
    return found


#: What each doubt is called, and what gives its numbers; in the order in which they are told.
_DOUBTS: tuple[tuple[int, str, Callable[[np.void, Basis], str] | None], ...] = (
    (doubts.MARGIN, 'low margin', margin_cause),
    (doubts.DISAGREE, 'filter and Hilbert envelope disagree on the amplitude', _two_amplitudes),
    (doubts.FROM_YAW, 'lateral amplitude is that of yaw through the mode shape', _spread),
    (doubts.OUTSIDE, 'motion that is not followed', lambda row, _: outside_words(row)),
    (doubts.OTHER, 'steady motion that is not the hunting of the normal form', _two_frequencies),
    (doubts.CONTRARY, 'lateral and yaw sensor contradict each other', None),
    (doubts.ON_LINE, 'hunting cannot be told from a line of the roller at its frequency', None),
    (doubts.NO_ESTIMATE, 'no estimate of the hunting amplitude yet', None),
    (doubts.SETTLING, 'not decided yet whether the motion is more than noise', None),
    (doubts.NO_SPEED, 'region unknown: no speed', None),
    (doubts.NO_FORM, 'region unknown: no normal form and no critical speeds', None),
    (
        doubts.IN_YAW,
        'lateral amplitude unknown: yaw is judged, by what its amplitude does alone',
        None,
    ),
    (doubts.DECAYING, 'hunting is dying out', None),
    (doubts.HYSTERESIS, 'hysteresis region: a disturbance can start hunting', region_cause),
    (doubts.UNSTABLE, 'above the linear critical speed', region_cause),
)


def causes_of(row: np.void) -> list[str]:
    """Return the codes of what makes a row ERROR or STALE (docs/alarm.md), the gravest first."""
    state, limits = State(int(row['state'])), int(row['limits'])
    found = [state.label] if state in _HUNTING else []
    for number, limit in enumerate(LIMITS):
        if limit.severity == 'alarm' and limits >> number & 1:
            found.append(limit.setting)
    for channel in CHANNELS:
        wrong = int(row[f'{channel}_wrong'])
        found += [f'{channel}_{code}' for bit, code in health.CODES.items() if wrong & bit]
    return found
