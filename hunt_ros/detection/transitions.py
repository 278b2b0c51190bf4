"""From rows to events: what changed from one row to the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts, health
from hunt_ros.detection.output import ESTIMATE_DTYPE, Event
from hunt_ros.detection.regions import Level, Region, State

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
                values = values & doubts.MARGIN
            elif name.endswith('_wrong'):
                values = values & (health.SILENT | health.FAULTS)
            last = self._before[name][0]
            earlier = np.concatenate(([last], values[:-1]))
            changed |= values != earlier
            before[name] = earlier
            self._before[name][0] = values[-1]
        events = []
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
        if low != bool(before['doubts']):
            found.append(('margin_low' if low else 'margin_restored', ''))
        old_state, state = State(before['state']), State(int(row['state']))
        # A disturbance that stays in the basin is a state, not an event.
        if state != old_state and (state in _STATES or old_state in _STATES):
            found.append((state.label, ''))
        return found


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
