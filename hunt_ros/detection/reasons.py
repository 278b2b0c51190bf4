"""Why the level is what it is, in words for an operator."""

from __future__ import annotations

import math

import numpy as np

from hunt_ros.detection import decisions, health
from hunt_ros.detection.regions import State
from hunt_ros.samples import CHANNELS

_DOUBTS: tuple[tuple[int, str], ...] = (
    (decisions.D_NO_ESTIMATE, 'no estimate of the hunting amplitude yet'),
    (decisions.D_SETTLING, 'learning the noise floor'),
    (decisions.D_NO_SPEED, 'region unknown: no speed'),
    (decisions.D_NO_FORM, 'region unknown: no normal form and no critical speeds'),
    (decisions.D_HYSTERESIS, 'hysteresis region: a disturbance can start hunting'),
    (decisions.D_UNSTABLE, 'above the linear critical speed'),
    (decisions.D_DECAYING, 'hunting is dying out'),
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
    doubts = int(row['doubts'])
    if doubts & decisions.D_MARGIN:
        found.append(f'margin {float(row["margin"]):.2f} is low')
    if doubts & decisions.D_DISAGREE:
        found.append('filter and Hilbert envelope disagree on the amplitude')
    found += [words for bit, words in _DOUBTS if doubts & bit]
    return (*found, *channel_reasons(row, health.MILD))


def channel_reasons(row: np.void, among: int) -> list[str]:
    """Return what is wrong with the channels in a row, as 'channel: words'."""
    found = []
    for channel in CHANNELS:
        wrong = int(row[f'{channel}_wrong']) & among
        found += [f'{channel}: {words}' for bit, words in health.WORDS.items() if wrong & bit]
    return found
