"""From rows to events: what changed from one row to the next."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts, health
from hunt_ros.detection.decision.limits import LIMITS, limit_cause
from hunt_ros.detection.output import Event, blank_rows, joined_rows, numbers_behind
from hunt_ros.detection.regions import Level, Region, State
from hunt_ros.detection.slow import CONTRADICTED_S, TOLERANCE_MPS
from hunt_ros.detection.words.reasons import (
    Basis,
    margin_cause,
    outside_words,
    reasons_of,
    region_cause,
    state_cause,
)
from hunt_ros.samples import CHANNELS, NANOSECONDS

#: What makes an event: word, test, cause, and since when, ns.
_Change = tuple[str, str, str, int]

#: A disturbance that stays in the basin is a state, not an event.
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
        Why the hunting that is in force was said; '' where there is none.
    decided_ns, level_since_ns : int
        Rows at which the state was decided, and from which on the level is in force; 0 before any.
    test : str
        Which test decided the state; '' before any.
    """

    def __init__(self, basis: Basis) -> None:
        self.basis = basis
        self._channels = tuple(name for name in CHANNELS if name in basis.config.channels)
        self._last = blank_rows(np.zeros(1, dtype=np.int64))
        self._last['level'] = -1
        #: When what lasts began.
        self._began_ns: dict[str, int] = {}
        self.decided, self.test = '', ''
        self.decided_ns = self.level_since_ns = 0

    def update(self, rows: NDArray[np.void]) -> list[Event]:
        """
        Return the events of new rows, in their order.

        Parameters
        ----------
        rows : ndarray of ESTIMATE_DTYPE, shape (m,)
            With level, region and state filled in; m > 0.
        """
        rows = joined_rows([self._last, rows])
        self._last = rows[-1:].copy()
        changed = back = np.diff(rows['stamp_ns']) < 0
        bits = {f'{name}_wrong': health.MISSING | health.FAULTS for name in self._channels}
        bits |= {'doubts': doubts.MARGIN | doubts.OUTSIDE}
        watched = [rows[name] for name in ('region', 'state', 'level', 'limits')]
        watched += [rows[name] & np.uint32(mask) for name, mask in bits.items()]
        for column in watched:
            changed = changed | (column[1:] != column[:-1])
        events = []
        for k in np.flatnonzero(changed).tolist():
            before, row = rows[k], rows[k + 1]
            if back[k]:  # the clocks were set: nobody knows how long ago it was
                self._began_ns.clear()
            if row['level'] != before['level']:
                self.level_since_ns = int(row['stamp_ns'])
            events += [self.event_of(row, *change) for change in self._changes(before, row)]
        return events

    @property
    def row(self) -> np.void:
        """The last row."""
        row: np.void = self._last[0]
        return row

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
        since_ns = stamp_ns if since_ns is None else since_ns
        form, numbers = self.basis.normal_form, numbers_behind(row)
        return Event(stamp_ns, word, level, since_ns, test, cause, form, numbers)

    def reasons(self, row: np.void) -> tuple[str, ...]:
        """Return why the level of a row is what it is, the most serious first."""
        return reasons_of(row, self.basis._replace(decided=self.decided))

    def _changes(self, before: np.void, row: np.void) -> Iterator[_Change]:
        """Yield what has changed since the row before."""
        for name in self._channels:
            yield from self._channel(name, int(before[f'{name}_wrong']), row)
        old, new = Region(int(before['region'])), Region(int(row['region']))
        if new != old:
            cause, since_ns = region_cause(row, self.basis), int(row['region_since_ns'])
            for region, word in ((old, 'left'), (new, 'entered')):
                if region in _REGIONS:
                    yield f'{_REGIONS[region]}_{word}', 'speed', cause, since_ns
        low = int(row['doubts']) & doubts.MARGIN
        if low != int(before['doubts']) & doubts.MARGIN:
            word = 'margin_low' if low else 'margin_restored'
            yield word, 'margin', margin_cause(row, self.basis), int(row['margin_since_ns'])
        for number, limit in enumerate(LIMITS):
            over, was = (int(x['limits']) & (1 << number) for x in (row, before))
            if over != was:
                word = 'limit_exceeded' if over else 'limit_cleared'
                cause = limit_cause(row, number, self.basis.config)
                yield word, limit.setting, cause, int(row['limit_since_ns'])
        outside = int(row['doubts']) & doubts.OUTSIDE
        if bool(outside) != bool(int(before['doubts']) & doubts.OUTSIDE):
            stamp_ns = int(row['stamp_ns'])
            word, cause = 'motion_outside_range', outside_words(row)
            if outside:
                self._began_ns['outside'] = stamp_ns
            else:
                word, cause = f'{word}_over', f'none is left{self._after("outside", stamp_ns)}'
            yield word, 'frequency_range', cause, stamp_ns
        was, state = State(int(before['state'])), State(int(row['state']))
        if state != was:
            self.test, self.decided = state_cause(row, self.basis)
            self.decided_ns = int(row['stamp_ns'])
            if {state, was} & _STATES:
                yield state.label, self.test, self.decided, int(row['state_since_ns'])

    def _channel(self, name: str, old: int, row: np.void) -> Iterator[_Change]:
        new, stamp_ns = int(row[f'{name}_wrong']), int(row['stamp_ns'])
        over_ns = stamp_ns - round(health.FAULT_HOLD_S * NANOSECONDS)
        timeout_ns = self.basis.config.timeout_ns(name)
        if (new ^ old) & health.MISSING:
            if new & health.MISSING:
                since_ns = self._began_ns[f'{name} silent'] = stamp_ns - timeout_ns
                cause = f'{name}: silent for {timeout_ns / NANOSECONDS:g} s'
                if new & health.ABSENT:
                    cause += f', but it is optional: {health.COSTS[name]}'
                yield 'input_stale', 'timeout', cause, since_ns
            else:
                cause = f'{name} is back{self._after(f"{name} silent", over_ns)}'
                yield 'input_recovered', 'timeout', cause, over_ns
        if new & health.FAULTS & ~old:
            # How long a fault has lasted when it is found, s.
            ages = {
                health.NO_VALUE: timeout_ns / NANOSECONDS,
                health.STUCK: health.STUCK_S,
                health.CONTRADICTED: CONTRADICTED_S,
            }
            found = {
                bit: ages.get(bit, 0.0) for bit in health.WORDS if new & health.FAULTS & ~old & bit
            }
            since_ns = stamp_ns - round(max(found.values()) * NANOSECONDS)
            self._began_ns.setdefault(f'{name} fault', since_ns)
            told = []
            for bit, age in found.items():
                by = f' by more than {TOLERANCE_MPS:g} m/s' if bit == health.CONTRADICTED else ''
                told.append(health.WORDS[bit] + by + (f' for {age:g} s' if age else ''))
            yield 'sensor_fault', 'sensor', f'{name}: {", ".join(told)}', since_ns
        elif old & health.FAULTS and not new & health.FAULTS:
            cause = f'{name}: no fault is left{self._after(f"{name} fault", over_ns)}'
            yield 'sensor_recovered', 'sensor', cause, over_ns

    def _after(self, what: str, over_ns: int) -> str:
        """Say how long something lasted that is over; '' where that is not known."""
        lasted_ns = over_ns - self._began_ns.pop(what, over_ns + 1)  # or the clock was set back
        return f' after {lasted_ns / NANOSECONDS:.2f} s' if lasted_ns >= 0 else ''
