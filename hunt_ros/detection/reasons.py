"""Why the level is what it is, in words for an operator."""

from __future__ import annotations

import math

import numpy as np

from hunt_ros.detection import doubts, health
from hunt_ros.detection.regions import State
from hunt_ros.samples import CHANNELS

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
    (doubts.TOO_SLOW, 'the strongest motion is slower than hunting_frequency_min_hz: not tracked'),
    (doubts.TOO_FAST, 'the strongest motion is faster than hunting_frequency_max_hz: not tracked'),
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
        found.append(f'escaping from the quiet state{soon}')
    elif state is State.LIMIT_CYCLE:
        found.append('limit cycle')
    bits = int(row['doubts'])
    if bits & doubts.MARGIN:
        margin = float(row['margin'])
        found.append('low margin' + (f': now {margin:.2f}' if math.isfinite(margin) else ''))
    if bits & doubts.DISAGREE:
        found.append('filter and Hilbert envelope disagree on the amplitude')
    if bits & doubts.FROM_YAW:
        spread = 100.0 * float(row['lateral_amplitude_std']) / float(row['lateral_amplitude'])
        found.append(
            f'lateral amplitude is that of yaw through the mode shape, +/- {spread:.0f} %'
        )
    found += [words for bit, words in _DOUBTS if bits & bit]
    return (*found, *channel_reasons(row, health.MILD))


def channel_reasons(row: np.void, among: int) -> list[str]:
    """Return what is wrong with the channels in a row, as 'channel: words'."""
    found = []
    for channel in CHANNELS:
        wrong = int(row[f'{channel}_wrong']) & among
        found += [f'{channel}: {words}' for bit, words in health.WORDS.items() if wrong & bit]
    return found
