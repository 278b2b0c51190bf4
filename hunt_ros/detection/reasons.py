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
    if bits & doubts.OUTSIDE:
        found.append(outside_words(row))
    found += [words for bit, words in _DOUBTS if bits & bit]
    return (*found, *channel_reasons(row, health.MILD))


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
