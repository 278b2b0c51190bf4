"""Why the level is what it is, and why something changed, in words for an operator."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts, health, states
from hunt_ros.detection.regions import Region, State
from hunt_ros.samples import CHANNELS

_HUNTING = {State.ESCAPING: 'escaping from the quiet state', State.LIMIT_CYCLE: 'limit cycle'}
_DISAGREE = 'filter and Hilbert envelope disagree on the amplitude'
#: Of the doubts that are told with their numbers, the words without.
_HELD: tuple[tuple[int, str], ...] = (
    (doubts.MARGIN, 'low margin'),
    (doubts.DISAGREE, _DISAGREE),
    (doubts.FROM_YAW, 'lateral amplitude is that of yaw through the mode shape'),
    (doubts.OUTSIDE, 'motion outside the hunting frequencies that are followed'),
)
_DOUBTS: tuple[tuple[int, str], ...] = (
    (doubts.NO_ESTIMATE, 'no estimate of the hunting amplitude yet'),
    (doubts.SETTLING, 'learning the noise floor'),
    (doubts.NO_SPEED, 'region unknown: no speed'),
    (doubts.NO_FORM, 'region unknown: no normal form and no critical speeds'),
    (doubts.HYSTERESIS, 'hysteresis region: a disturbance can start hunting'),
    (doubts.UNSTABLE, 'above the linear critical speed'),
    (doubts.DECAYING, 'hunting is dying out'),
    (
        doubts.IN_YAW,
        'lateral amplitude unknown: yaw is judged, by its growth and steadiness alone',
    ),
)


def reasons_of(row: np.void) -> tuple[str, ...]:
    """
    Put a row of the estimates into words.

    Parameters
    ----------
    row : void of ESTIMATE_DTYPE
        One row.

    Returns
    -------
    tuple of str
        The most serious first; empty where all is well.
    """
    found = [*channel_reasons(row, health.SEVERE)]
    state = State(int(row['state']))
    if state is State.ESCAPING:
        time = float(row['time_to_limit_cycle'])
        soon = f', limit cycle in about {time:.1f} s' if math.isfinite(time) else ''
        found.append(f'{_HUNTING[state]}{soon}')
    elif state is State.LIMIT_CYCLE:
        found.append(_HUNTING[state])
    bits = int(row['doubts'])
    if bits & doubts.MARGIN:
        margin = float(row['margin'])
        found.append('low margin' + (f': now {margin:.2f}' if math.isfinite(margin) else ''))
    if bits & doubts.DISAGREE:
        found.append(_DISAGREE)
    if bits & doubts.FROM_YAW:
        spread = 100.0 * float(row['lateral_amplitude_std']) / float(row['lateral_amplitude'])
        found.append(
            f'lateral amplitude is that of yaw through the mode shape, +/- {spread:.0f} %'
        )
    if bits & doubts.OUTSIDE:
        found.append(outside_words(row))
    found += [words for bit, words in _DOUBTS if bits & bit]
    return (*found, *channel_reasons(row, health.MILD))


def state_cause(row: np.void) -> str:
    """Return the evidence that led to the state of a row, with its numbers."""
    in_yaw = bool(int(row['doubts']) & doubts.IN_YAW)
    name, unit = ('yaw', 'mrad') if in_yaw else ('lateral', 'mm')
    a, s = 1e3 * float(row[f'{name}_amplitude']), 1e3 * float(row[f'{name}_amplitude_std'])
    unstable, stable = 1e3 * float(row['unstable_amplitude']), 1e3 * float(row['stable_amplitude'])
    growth = f'{float(row["growth_rate"]):.2g} +/- {float(row["growth_rate_std"]):.1g} 1/s'
    chance = f'{100.0 * float(row["escape_probability"]):.0f} %'
    size = f'the amplitude {a:.3g} +/- {s:.1g} {unit}'
    edge = f' (unstable amplitude {unstable:.3g} mm)' if math.isfinite(unstable) else ''
    words = {
        states.BEYOND: f'{size} ends on the limit cycle with a probability of {chance}{edge}',
        states.ARRIVED: f'{size} has reached the limit cycle'
        + (f' ({stable:.3g} mm)' if math.isfinite(stable) else ''),
        states.STEADY: f'{size} stays as that of a limit cycle does',
        states.GROWING: f'{size} grows for sure, by {growth}',
        states.COMES_BACK: f'{size} ends on the limit cycle with a probability of {chance} only',
        states.FALLS: f'{size} falls for sure, by {growth}',
        states.SMALLER: f'{size} is far below that of the limit cycle it was on',
        states.OVER: f'{size} is that of the quiet motion again',
    }
    return words.get(int(row['state_cause']), size)


def region_cause(row: np.void, boundaries: tuple[float, float]) -> str:
    """Say where the speed of a row lies; `boundaries` are v_n and v_c, m/s."""
    v_n, v_c = boundaries
    speed = float(row['speed'])
    if math.isnan(speed):
        return 'the speed is not known'
    region = Region(int(row['region']))
    fold = f'v_n = {v_n:.3f} m/s' if v_n > 0.0 else 'the fold, which is not known'
    words = {
        Region.STABLE: f'is below {fold if math.isfinite(v_n) else f"v_c = {v_c:.3f} m/s"}',
        Region.HYSTERESIS: f'lies between {fold} and v_c = {v_c:.3f} m/s',
        Region.UNSTABLE: f'is above v_c = {v_c:.3f} m/s',
    }
    return f'the speed {speed:.3f} m/s ' + words.get(region, 'has no known boundaries')


def margin_cause(row: np.void, limit: float) -> str:
    """Compare the margin of a row with its limit."""
    margin = float(row['margin'])
    if math.isnan(margin):
        return 'there is no unstable amplitude at this speed'
    return (
        f'unstable amplitude over amplitude is {margin:.3g}'
        f' ({float(row["margin_low"]):.3g} to {float(row["margin_high"]):.3g}), limit {limit:g}'
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
    columns = [(rows['doubts'], '', (*_HELD, *_DOUBTS))]
    channel_words = tuple(health.WORDS.items())
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
    """Say of a row with motion outside the range that is followed what it is, and what to do."""
    lateral, yaw = float(row['outside_lateral']), float(row['outside_yaw'])
    if math.isfinite(lateral):
        motion = f'a motion of {1e3 * lateral:.2g} mm'
    else:
        motion = f'a yaw motion of {1e3 * yaw:.2g} mrad'
    low, high = float(row['followed_min_hz']), float(row['followed_max_hz'])
    return (
        f'{motion} at {float(row["outside_hz"]):.2g} Hz lies outside the hunting frequencies'
        f' {low:.3g} to {high:.3g} Hz that are followed: set hunting_frequency_hz if it is hunting'
    )


def channel_reasons(row: np.void, among: int) -> list[str]:
    """Return what is wrong with the channels in a row, as 'channel: words'."""
    found = []
    for channel in CHANNELS:
        wrong = int(row[f'{channel}_wrong']) & among
        found += [f'{channel}: {words}' for bit, words in health.WORDS.items() if wrong & bit]
    return found
