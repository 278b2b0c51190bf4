"""From rows to events: what changed from one row to the next."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts, health
from hunt_ros.detection.output import ESTIMATE_DTYPE, Event
from hunt_ros.detection.reasons import outside_words
from hunt_ros.detection.regions import Level, Region, State

#: Motion outside the range is named again when it has grown by this factor.
_GROWN = 10.0
_STATES = {State.ESCAPING, State.LIMIT_CYCLE, State.DECAYING}
_REGIONS = {Region.HYSTERESIS: 'hysteresis', Region.UNSTABLE: 'unstable'}


class Transitions:
    """
    Remembers the last row, and names what changed since.

    Parameters
    ----------
    channels : tuple of str
        Channels that are watched.
    """

    def __init__(self, channels: tuple[str, ...]) -> None:
        self._channels = channels
        self._before = np.zeros(1, dtype=ESTIMATE_DTYPE)
        self._said: dict[str, float] = {}

    def update(self, rows: NDArray[np.void]) -> list[Event]:
        """
        Return the events of new rows, in their order.

        Parameters
        ----------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
            With level, region and state filled in; m > 0.
        """
        watched = ['region', 'state']
        changed = np.zeros(rows.size, dtype=np.bool_)
        before = {}
        for name in (*watched, 'doubts', *(f'{name}_wrong' for name in self._channels)):
            values = rows[name]
            if name == 'doubts':
                values = values & (doubts.MARGIN | doubts.OUTSIDE)
            elif name.endswith('_wrong'):
                values = values & (health.SILENT | health.FAULTS)
            last = self._before[name][0]
            earlier = np.concatenate(([last], values[:-1]))
            changed |= values != earlier
            before[name] = earlier
            self._before[name][0] = values[-1]
        events = []
        # Motion outside the range is looked at in every row: it may have grown.
        changed |= (rows['doubts'] & doubts.OUTSIDE) != 0
        for k in np.flatnonzero(changed).tolist():
            row = rows[k]
            for word, detail in self._changes(
                row, {name: int(x[k]) for name, x in before.items()}
            ):
                events.append(event_of(row, word, detail))
        return events

    def _changes(self, row: np.void, before: dict[str, int]) -> list[tuple[str, str]]:
        found: list[tuple[str, str]] = []
        for name in self._channels:
            found += _channel_changes(name, before[f'{name}_wrong'], int(row[f'{name}_wrong']))
        old_region, region = Region(before['region']), Region(int(row['region']))
        if region != old_region:
            if old_region in _REGIONS:
                found.append((f'{_REGIONS[old_region]}_left', ''))
            if region in _REGIONS:
                found.append((f'{_REGIONS[region]}_entered', ''))
        low = bool(int(row['doubts']) & doubts.MARGIN)
        if low != bool(before['doubts'] & doubts.MARGIN):
            found.append(('margin_low' if low else 'margin_restored', ''))
        found += self._outside(row, before['doubts'])
        old_state, state = State(before['state']), State(int(row['state']))
        # A disturbance that stays in the basin is a state, not an event.
        if state != old_state and (state in _STATES or old_state in _STATES):
            found.append((state.label, ''))
        return found

    def _outside(self, row: np.void, doubts_before: int) -> list[tuple[str, str]]:
        """Name motion outside the range when it is seen, and again when it has grown."""
        if not int(row['doubts']) & doubts.OUTSIDE:
            self._said = {}
            over = doubts_before & doubts.OUTSIDE
            return [('motion_outside_range_over', '')] if over else []
        channel = 'lateral' if math.isfinite(row['outside_lateral']) else 'yaw'
        amplitude = float(row[f'outside_{channel}'])
        if self._said:
            before = self._said.get(channel, 0.0 if channel == 'lateral' else math.inf)
            if not amplitude > _GROWN * before:
                return []
        self._said[channel] = amplitude
        return [('motion_outside_range', outside_words(row))]


def _channel_changes(name: str, old: int, new: int) -> list[tuple[str, str]]:
    found = []
    if (new ^ old) & health.SILENT:
        found.append(('input_stale' if new & health.SILENT else 'input_recovered', name))
    faults, cleared = new & health.FAULTS, old & health.FAULTS
    if faults & ~cleared:
        words = [health.WORDS[bit] for bit in health.WORDS if faults & ~cleared & bit]
        found.append(('sensor_fault', f'{name}: {", ".join(words)}'))
    elif cleared and not faults:
        found.append(('sensor_recovered', name))
    return found


def event_of(row: np.void, word: str, detail: str = '') -> Event:
    """Return the event of a word at a row."""
    amplitude = float(row['lateral_amplitude'])
    return Event(
        int(row['stamp_ns']),
        word,
        float(row['speed']),
        amplitude,
        float(row['growth_rate']),
        Level(int(row['level'])),
        detail,
    )
