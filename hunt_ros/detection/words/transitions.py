"""From rows to events: what changed from one row to the next."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts
from hunt_ros.detection.channels import health
from hunt_ros.detection.channels.speed_check import CONTRADICTED_S, TOLERANCE_MPS
from hunt_ros.detection.decision.limits import LIMITS, limit_cause
from hunt_ros.detection.output import ESTIMATE_DTYPE, Event, numbers_behind
from hunt_ros.detection.regions import Level, Region, State
from hunt_ros.detection.words.reasons import (
    Basis,
    margin_cause,
    outside_words,
    reasons_of,
    region_cause,
    state_cause,
)
from hunt_ros.samples import CHANNELS, NANOSECONDS

#: An event without the numbers of its row: word, test, cause, and since when, ns.
_Change = tuple[str, str, str, int]

#: Motion outside the range is named again when it has grown by this factor.
_GROWN = 10.0
#: A channel gives nothing: a fault, or one that is optional.
_MISSING = health.SILENT | health.ABSENT
_STATES = {State.ESCAPING, State.LIMIT_CYCLE, State.DECAYING}
_REGIONS = {Region.HYSTERESIS: 'hysteresis', Region.UNSTABLE: 'unstable'}


class Transitions:
    """
    Remembers the last row, and names what changed since.

    Parameters
    ----------
    basis : Basis
        Names the channels, and the limits that the causes speak of.

    Attributes
    ----------
    basis : Basis
    decided : str
        Why the hunting that is in force was said; '' where there is none, or where it was said
        before a restart.
    decided_ns, level_since_ns : int
        Rows at which the state was decided, and from which on the level is in force; 0 before any.
    test : str
        Which test decided the state; '' before any.
    """

    def __init__(self, basis: Basis) -> None:
        self.basis = basis
        self._channels = tuple(name for name in CHANNELS if name in basis.config.channels)
        self._before = np.zeros(1, dtype=ESTIMATE_DTYPE)
        self._before['level'] = -1
        self._said: dict[str, float] = {}
        self._began_ns: dict[str, int] = {}
        self.decided, self.test = '', ''
        self.decided_ns = self.level_since_ns = 0

    def remember(self, state: State) -> None:
        """Take a state for that of the row before the first."""
        self._before['state'] = state

    def update(self, rows: NDArray[np.void]) -> list[Event]:
        """
        Return the events of new rows, in their order.

        Parameters
        ----------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
            With level, region and state filled in; m > 0.
        """
        watched = ['region', 'state', 'level', 'limits']
        changed = np.zeros(rows.size, dtype=np.bool_)
        before = {}
        for name in (*watched, 'doubts', *(f'{name}_wrong' for name in self._channels)):
            values = rows[name]
            if name == 'doubts':
                values = values & (doubts.MARGIN | doubts.OUTSIDE)
            elif name.endswith('_wrong'):
                values = values & (_MISSING | health.FAULTS)
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
            if row['level'] != before['level'][k]:
                self.level_since_ns = int(row['stamp_ns'])
            for word, test, cause, since_ns in self._changes(
                row, {name: int(x[k]) for name, x in before.items()}
            ):
                events.append(self.event_of(row, word, test, cause, since_ns))
        return events

    def event_of(
        self, row: np.void, word: str, test: str, cause: str, since_ns: int | None = None
    ) -> Event:
        """
        Return the event of a word at a row.

        Where the level is WARN or STALE for more than the cause of the event, the cause says
        that too. `since_ns` None: it began with the row.
        """
        stamp_ns, level = int(row['stamp_ns']), Level(int(row['level']))
        reasons = self.reasons(row)
        if level in (Level.WARN, Level.STALE) and reasons:
            told = reasons[0]
            if told not in cause and cause not in told:
                cause += f'; {level.label}: {told}'
        return Event(
            stamp_ns,
            word,
            level,
            stamp_ns if since_ns is None else since_ns,
            test,
            cause,
            self.basis.normal_form,
            numbers_behind(row),
        )

    def reasons(self, row: np.void) -> tuple[str, ...]:
        """Return why the level of a row is what it is, the most serious first."""
        return reasons_of(row, self.basis, self.decided)

    def _changes(self, row: np.void, before: dict[str, int]) -> list[_Change]:
        """Return what has changed since the row before: word, test, cause, since when."""
        found: list[_Change] = []
        for name in self._channels:
            found += self._channel(name, before[f'{name}_wrong'], row)
        old_region, region = Region(before['region']), Region(int(row['region']))
        if region != old_region:
            cause, since_ns = region_cause(row, self.basis), int(row['region_since_ns'])
            if old_region in _REGIONS:
                found.append((f'{_REGIONS[old_region]}_left', 'speed', cause, since_ns))
            if region in _REGIONS:
                found.append((f'{_REGIONS[region]}_entered', 'speed', cause, since_ns))
        low = bool(int(row['doubts']) & doubts.MARGIN)
        if low != bool(before['doubts'] & doubts.MARGIN):
            word = 'margin_low' if low else 'margin_restored'
            cause = margin_cause(row, self.basis)
            found.append((word, 'margin', cause, int(row['margin_since_ns'])))
        for number, limit in enumerate(LIMITS):
            if (int(row['limits']) ^ before['limits']) & (1 << number):
                over = int(row['limits']) & (1 << number)
                word = 'limit_exceeded' if over else 'limit_cleared'
                cause = limit_cause(row, number, self.basis.config)
                found.append((word, limit.setting, cause, int(row['limit_since_ns'])))
        found += self._outside(row, before['doubts'])
        old_state, state = State(before['state']), State(int(row['state']))
        if state != old_state:
            self.test, self.decided = state_cause(row, self.basis)
            self.decided_ns = int(row['stamp_ns'])
            # A disturbance that stays in the basin is a state, not an event.
            if state in _STATES or old_state in _STATES:
                since_ns = int(row['state_since_ns'])
                found.append((state.label, self.test, self.decided, since_ns))
        return found

    def _channel(self, name: str, old: int, row: np.void) -> list[_Change]:
        new, stamp_ns = int(row[f'{name}_wrong']), int(row['stamp_ns'])
        over_ns = stamp_ns - round(health.FAULT_HOLD_S * NANOSECONDS)
        found: list[_Change] = []
        if (new ^ old) & _MISSING:
            if new & _MISSING:
                age = self.basis.config.timeout_ns(name)
                self._began_ns[f'{name} silent'] = since_ns = stamp_ns - age
                cause = f'{name}: silent for {age / NANOSECONDS:g} s'
                if new & health.ABSENT:
                    cause += f', but it is optional: {health.COSTS[name]}'
                found.append(('input_stale', 'timeout', cause, since_ns))
            else:
                cause = f'{name} is back{self._after(f"{name} silent", over_ns)}'
                found.append(('input_recovered', 'timeout', cause, over_ns))
        faults, cleared = new & health.FAULTS & ~old, old & health.FAULTS
        if faults:
            bits = [bit for bit in health.WORDS if faults & bit]
            since_ns = stamp_ns - max(self._age_ns(name, bit) for bit in bits)
            self._began_ns.setdefault(f'{name} fault', since_ns)
            words = ', '.join(health.WORDS[bit] + self._limit(name, bit) for bit in bits)
            found.append(('sensor_fault', 'sensor', f'{name}: {words}', since_ns))
        elif cleared and not new & health.FAULTS:
            cause = f'{name}: no fault is left{self._after(f"{name} fault", over_ns)}'
            found.append(('sensor_recovered', 'sensor', cause, over_ns))
        return found

    def _after(self, what: str, over_ns: int) -> str:
        """Say how long something lasted that is over."""
        began_ns = self._began_ns.pop(what, None)
        return '' if began_ns is None else f' after {(over_ns - began_ns) / NANOSECONDS:.2f} s'

    def _limit(self, channel: str, fault: int) -> str:
        """Say what a fault was found by."""
        age = self._age_ns(channel, fault) / NANOSECONDS
        if fault == health.CONTRADICTED:
            return f' by more than {TOLERANCE_MPS:g} m/s for {age:g} s'
        return f' for {age:g} s' if age > 0.0 else ''

    def _age_ns(self, channel: str, fault: int) -> int:
        """Return how long a fault has lasted when it is found, ns."""
        ages = {
            health.NO_VALUE: self.basis.config.timeout_ns(channel),
            health.STUCK: round(health.STUCK_S * NANOSECONDS),
            health.CONTRADICTED: round(CONTRADICTED_S * NANOSECONDS),
        }
        return ages.get(fault, 0)

    def _outside(self, row: np.void, doubts_before: int) -> list[_Change]:
        """Name motion outside the range when it is seen, and again when it has grown."""
        test, stamp_ns = 'frequency_range', int(row['stamp_ns'])
        if not int(row['doubts']) & doubts.OUTSIDE:
            self._said = {}
            if not doubts_before & doubts.OUTSIDE:
                return []
            cause = f'none is left{self._after("outside", stamp_ns)}'
            return [('motion_outside_range_over', test, cause, stamp_ns)]
        channel = 'lateral' if math.isfinite(row['outside_lateral']) else 'yaw'
        amplitude = float(row[f'outside_{channel}'])
        if self._said:
            before = self._said.get(channel, 0.0 if channel == 'lateral' else math.inf)
            if not amplitude > _GROWN * before:
                return []
        self._said[channel] = amplitude
        since_ns = self._began_ns.setdefault('outside', stamp_ns)
        return [('motion_outside_range', test, outside_words(row), since_ns)]
