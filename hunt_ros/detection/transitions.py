"""From rows to events: what changed from one row to the next."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts, health
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.output import ESTIMATE_DTYPE, Event
from hunt_ros.detection.reasons import (
    margin_cause,
    outside_words,
    reasons_of,
    region_cause,
    state_cause,
)
from hunt_ros.detection.regions import Level, Region, State
from hunt_ros.samples import CHANNELS, NANOSECONDS

#: An event without the numbers of its row: word, cause, and since when, ns.
_Change = tuple[str, str, int]

#: Motion outside the range is named again when it has grown by this factor.
_GROWN = 10.0
_STATES = {State.ESCAPING, State.LIMIT_CYCLE, State.DECAYING}
_REGIONS = {Region.HYSTERESIS: 'hysteresis', Region.UNSTABLE: 'unstable'}


class Transitions:
    """
    Remembers the last row, and names what changed since.

    Parameters
    ----------
    config : DetectorConfig
        Names the channels, and the limits that the causes speak of.

    Attributes
    ----------
    config : DetectorConfig
    """

    def __init__(self, config: DetectorConfig) -> None:
        self.config = config
        self._channels = tuple(name for name in CHANNELS if name in config.channels)
        self._before = np.zeros(1, dtype=ESTIMATE_DTYPE)
        self._said: dict[str, float] = {}

    def remember(self, state: State) -> None:
        """Take a state for that of the row before the first."""
        self._before['state'] = state

    def update(self, rows: NDArray[np.void], boundaries: tuple[float, float]) -> list[Event]:
        """
        Return the events of new rows, in their order.

        Parameters
        ----------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
            With level, region and state filled in; m > 0.
        boundaries : tuple of float
            v_n and v_c, m/s; NaN where there is none.
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
            for word, cause, since_ns in self._changes(
                row, {name: int(x[k]) for name, x in before.items()}, boundaries
            ):
                events.append(event_of(row, word, cause, since_ns))
        return events

    def _changes(
        self, row: np.void, before: dict[str, int], boundaries: tuple[float, float]
    ) -> list[_Change]:
        found: list[_Change] = []
        for name in self._channels:
            found += self._channel(name, before[f'{name}_wrong'], row)
        old_region, region = Region(before['region']), Region(int(row['region']))
        if region != old_region:
            cause, since_ns = region_cause(row, boundaries), int(row['region_since_ns'])
            if old_region in _REGIONS:
                found.append((f'{_REGIONS[old_region]}_left', cause, since_ns))
            if region in _REGIONS:
                found.append((f'{_REGIONS[region]}_entered', cause, since_ns))
        low = bool(int(row['doubts']) & doubts.MARGIN)
        if low != bool(before['doubts'] & doubts.MARGIN):
            limit = self.config.margin_in if low else self.config.margin_out
            word = 'margin_low' if low else 'margin_restored'
            found.append((word, margin_cause(row, limit), int(row['margin_since_ns'])))
        found += self._outside(row, before['doubts'])
        old_state, state = State(before['state']), State(int(row['state']))
        # A disturbance that stays in the basin is a state, not an event.
        if state != old_state and (state in _STATES or old_state in _STATES):
            found.append((state.label, state_cause(row), int(row['state_since_ns'])))
        return found

    def _channel(self, name: str, old: int, row: np.void) -> list[_Change]:
        new, stamp_ns = int(row[f'{name}_wrong']), int(row['stamp_ns'])
        over_ns = stamp_ns - round(self.config.fault_hold_s * NANOSECONDS)
        found = []
        if (new ^ old) & health.SILENT:
            silent = bool(new & health.SILENT)
            age = self.config.timeout_ns(name)
            cause = f'{name}: silent for {age / NANOSECONDS:g} s' if silent else f'{name} is back'
            word = 'input_stale' if silent else 'input_recovered'
            found.append((word, cause, stamp_ns - age if silent else over_ns))
        faults, cleared = new & health.FAULTS & ~old, old & health.FAULTS
        if faults:
            words = ', '.join(health.WORDS[bit] for bit in health.WORDS if faults & bit)
            age = max(self._age_ns(name, bit) for bit in health.WORDS if faults & bit)
            found.append(('sensor_fault', f'{name}: {words}', stamp_ns - age))
        elif cleared and not new & health.FAULTS:
            found.append(('sensor_recovered', f'{name}: no fault is left', over_ns))
        return found

    def _age_ns(self, channel: str, fault: int) -> int:
        """Return how long a fault has lasted when it is found, ns."""
        config = self.config
        ages = {
            health.NO_VALUE: config.timeout_ns(channel),
            health.STUCK: round(config.stuck_time_s * NANOSECONDS),
            health.CONTRADICTED: round(config.speed_contradiction_hold_s * NANOSECONDS),
        }
        return ages.get(fault, 0)

    def _outside(self, row: np.void, doubts_before: int) -> list[_Change]:
        """Name motion outside the range when it is seen, and again when it has grown."""
        if not int(row['doubts']) & doubts.OUTSIDE:
            self._said = {}
            over = doubts_before & doubts.OUTSIDE
            cause = 'none is left'
            return [('motion_outside_range_over', cause, int(row['stamp_ns']))] if over else []
        channel = 'lateral' if math.isfinite(row['outside_lateral']) else 'yaw'
        amplitude = float(row[f'outside_{channel}'])
        if self._said:
            before = self._said.get(channel, 0.0 if channel == 'lateral' else math.inf)
            if not amplitude > _GROWN * before:
                return []
        self._said[channel] = amplitude
        return [('motion_outside_range', outside_words(row), int(row['stamp_ns']))]


def event_of(row: np.void, word: str, cause: str, since_ns: int | None = None) -> Event:
    """
    Return the event of a word at a row.

    Where the level is WARN or STALE for more than the cause of the event, the cause says that
    too. `since_ns` None: it began with the row.
    """
    stamp_ns, level = int(row['stamp_ns']), Level(int(row['level']))
    reasons = reasons_of(row)
    if level in (Level.WARN, Level.STALE) and reasons and reasons[0] not in cause:
        cause += f'; {level.label}: {reasons[0]}'
    return Event(
        stamp_ns,
        word,
        float(row['speed']),
        float(row['lateral_amplitude']),
        float(row['growth_rate']),
        level,
        stamp_ns if since_ns is None else since_ns,
        cause,
    )
