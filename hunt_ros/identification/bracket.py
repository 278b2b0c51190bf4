"""
What a lab sees by eye: bounds on v_n, v_c and the unstable amplitude without any model.

What dies although it was as large as a limit cycle is below
v_n; what stays is above; what small motion does tells on which side of v_c it is; rest and a
limit cycle at one speed are a subcritical rig. Every bound names the events it rests on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from hunt_ros.analysis.steady_state import ABOVE_NOISE, threshold_of_motion
from hunt_ros.dynamics.growth_law import GrowthLaw
from hunt_ros.identification.record.events import ONE_SPEED, SMALLEST, Event, events_of
from hunt_ros.identification.record.plateaus import Run
from hunt_ros.samples import as_json

Bounds = tuple[float | None, float | None]

#: Chance below which rest and a law that lets it grow exclude each other.
_CHANCE = 1e-3


@dataclass(frozen=True)
class Bracket:
    """
    Bounds that need no model.

    Parameters
    ----------
    events : tuple of Event
        What was seen, in the order of the recordings.
    v_n : (float or None, float or None)
        Speeds between which the limit cycle ends, m/s: v_n, or v_c on a supercritical rig; None
        for a side that nothing bounds.
    v_c : float or None
        Speed above which it lies, m/s: that of rest whose damping was seen, or of a kick that
        died. Nothing seen once bounds it from above: noise throws a subcritical rig out of rest
        before v_c.
    began : float or None
        Lowest speed at which hunting began out of rest, unkicked, m/s.
    coexistence : (float, float) or None
        Speeds over which rest and a limit cycle were both seen, m/s: the rig is subcritical.
    unstable : tuple of (float, float, float)
        Speed, m/s, and the amplitudes between which the unstable limit cycle lies there, m;
        NaN for a side that nothing bounds.
    why : mapping of str to Event
        The event behind 'v_n_above', 'v_n_below', 'v_c_above', 'rest', 'stayed'.
    """

    events: tuple[Event, ...] = ()
    v_n: Bounds = (None, None)
    v_c: float | None = None
    began: float | None = None
    coexistence: tuple[float, float] | None = None
    unstable: tuple[tuple[float, float, float], ...] = ()
    why: dict[str, Event] = field(default_factory=dict)

    @property
    def kicks(self) -> list[tuple[str, int]]:
        """Source and stamp, ns, of the beginning of each motion that was kicked."""
        return [(e.source, e.start_ns) for e in self.events if math.isfinite(e.kick)]

    def lines(self) -> list[str]:
        """Return what was seen, a line each, as it is printed first."""
        lines = []
        if self.coexistence is not None:
            low, high = self.coexistence
            at = f'{low:.4g}' if high - low < ONE_SPEED * high else f'{low:.4g} to {high:.4g}'
            rest, cycle = self.why['rest'], self.why['stayed']
            lines.append(
                f'seen: subcritical: rest ({rest.seconds:.3g} s at {_at(rest)} m/s) and a limit'
                f' cycle ({1e3 * cycle.amplitude:.3g} mm, {cycle.seconds:.3g} s at'
                f' {_at(cycle)} m/s) at {at} m/s'
            )
        reasons = [_words(self.why[k]) for k in ('v_n_above', 'v_n_below') if k in self.why]
        if reasons:
            name = 'v_n' if self.coexistence else 'the limit cycle ends'
            lines.append(f'seen: {name} {_between(*self.v_n)}: {"; ".join(reasons)}')
        if self.v_c is not None:
            lines.append(f'seen: v_c {_between(self.v_c, None)}: {self._damping()}')
        if self.began is not None:
            line = f'seen: hunting began, unkicked, at {self.began:.4g} m/s'
            rested = max((e.speed_low for e in self.events if e.kind == 'rest'), default=0.0)
            if rested > self.began:
                line += (
                    f', out of rest that was seen up to {rested:.4g} m/s: random motion may do'
                    ' that below v_c'
                )
            lines.append(line)
        bounded = [row for row in self.unstable if self.coexistence and math.isfinite(row[2])]
        for speed, above, below in bounded[:3]:
            over = f'{1e3 * above:.3g} to ' if math.isfinite(above) else 'below '
            lines.append(f'seen: unstable amplitude {over}{1e3 * below:.3g} mm at {speed:.4g} m/s')
        return lines

    def where(self, coexist: Callable[[float], bool]) -> Bracket:
        """Return the same with coexistence only at speeds, m/s, where rest and cycle can."""
        rest = self.coexistence and _beside(self.events, self.why['stayed'], coexist)
        if not (rest and self.coexistence):
            return replace(self, coexistence=None)
        both = self.coexistence[0], rest.speed_high
        return replace(self, coexistence=both, why={**self.why, 'rest': rest})

    def _damping(self) -> str:
        """Return what bounds v_c from below in words."""
        why = self.why['v_c_above']
        if not why.damped:
            return _words(why)
        return (
            f'{_words(why)} ({1e6 * why.amplitude:.2g} um; without damping the forcing there makes'
            f' it more than {1e6 * why.undamped:.2g} um in 99 of 100 cases)'
        )

    def to_json(self) -> dict[str, Any]:
        """Return the entry `bracket`."""
        return {
            'lines': self.lines(),
            'criticality': 'subcritical' if self.coexistence else None,
            'coexistence_mps': as_json(self.coexistence),
            'v_n_between_mps': list(self.v_n) if self.coexistence else [None, None],
            'cycle_ends_between_mps': list(self.v_n),
            'v_c_above_mps': self.v_c,
            'began_mps': self.began,
            'unstable_amplitude': [
                dict(zip(('speed_mps', 'above_m', 'below_m'), as_json(row), strict=True))
                for row in self.unstable
                if self.coexistence
            ],
            'because': {key: _words(event) for key, event in self.why.items()},
            'events': [event.to_json() for event in self.events],
        }


def refutations(law: GrowthLaw, forcing: Callable[[float], float], bracket: Bracket) -> list[str]:
    """
    Return what a law says that the events behind the bounds contradict, in words.

    Parameters
    ----------
    law : GrowthLaw
        Of a fit.
    forcing : callable
        Noise intensity D at a speed, m^2/s; NaN where none is seen.
    bracket : Bracket
        What was seen.
    """
    found = []
    for event in dict.fromkeys(bracket.why.values()):
        if contradicts(law, forcing, event):
            says = {
                'rest': f'small motion grows by {law.growth_rate(event.speed, 0.0):.2g} 1/s',
                'stayed': 'there is no limit cycle',
                'died': 'it grows',
            }[event.kind]
            found.append(f'at {_at(event)} m/s {says} by the law; seen: {_words(event)}')
    return found


def contradicts(law: GrowthLaw, forcing: Callable[[float], float], event: Event) -> bool:
    """
    Whether a law and an event exclude each other, by more than noise does.

    Parameters
    ----------
    law : GrowthLaw
        Of a fit, or drawn.
    forcing : callable
        As in `refutations`.
    event : Event
        Rest that forcing and growth, from nothing, leave as small once in a thousand times; what
        stayed where the law lets it die within a tenth of the time; what died where the law lets
        half of it grow.
    """
    if event.kind == 'rest':
        rate, lasted = float(law.growth_rate(event.speed, 0.0)), event.seconds
        if not rate > 0.0:
            return False
        # The square of such motion is exponential, of this mean.
        square = 2.0 * forcing(event.speed) * math.expm1(min(2.0 * rate * lasted, 600.0)) / rate
        return event.spread[1] ** 2 < _CHANCE * square
    if event.kind == 'stayed':
        speed = event.speed_low * (1.0 + 0.5 * ONE_SPEED)
        if np.isfinite(law.steady_amplitudes(speed)[1][0]):
            return False
        return float(law.growth_rate(speed, event.amplitude)) * event.seconds < -10.0
    if event.kind == 'died':
        unstable, stable = law.steady_amplitudes(event.speed_low * (1.0 - 0.5 * ONE_SPEED))
        return bool(np.isfinite(stable[0]) and np.nan_to_num(unstable[0]) < 0.5 * event.amplitude)
    return False


def _at(event: Event) -> str:
    """Return the speeds of an event."""
    low, high = event.speed_low, event.speed_high
    return f'{low:.4g}' if high - low < ONE_SPEED * high else f'{low:.4g} to {high:.4g}'


def _between(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        bounds = f'between {low:.4g} and {high:.4g}'
    else:
        bounds = f'above {low:.4g}' if low is not None else f'below {high:.4g}'
    return f'{bounds} m/s ({50.0 * ONE_SPEED:g} % to spare)'


def _words(event: Event) -> str:
    """Return an event in a few words."""
    size, at = f'{1e3 * event.amplitude:.3g} mm', _at(event)
    words = {
        'rest': f'rest for {event.seconds:.3g} s at {at} m/s',
        'stayed': f'{size} stayed for {event.seconds:.3g} s at {at} m/s',
        'died': f'{size} died out at {at} m/s',
    }
    return words[event.kind]


def bracket_of(runs: Sequence[Run]) -> Bracket:
    """
    Find the events, and what they bound.

    Parameters
    ----------
    runs : sequence of Run
        Of all recordings.

    Returns
    -------
    Bracket
        Where all amplitudes are of one kind only rest whose damping was seen: of the others
        nothing tells whether they are rest or a limit cycle.
    """
    seen = [run.seen for run in runs]
    amplitude = np.concatenate([one.amplitude for one in seen])
    large = threshold_of_motion(amplitude)
    if large is None:
        one_kind = float(np.nanmedian(amplitude)), math.inf, math.inf
        return _bounds([e for e in _events(runs, one_kind) if e.damped], math.inf)
    rest = float(np.median(amplitude[np.isfinite(amplitude) & (amplitude <= large)]))
    large = max(large, ABOVE_NOISE * rest)
    # Kicks reach further than any limit cycle, for an instant. Motion at another frequency is none
    # of hunting, and no rest either.
    sizes = [
        np.fmax(one.amplitude, np.where(np.isfinite(one.amplitude), one.residual, np.nan))
        for one in seen
    ]
    top = max(float(np.nanmax(median_filter(size, size=7))) for size in sizes)
    return _bounds(_events(runs, (rest, large, top)), top)


def _events(runs: Sequence[Run], levels: tuple[float, float, float]) -> list[Event]:
    """Return the events of all runs by the levels of `events_of`."""
    return [event for run in runs for event in events_of(run.seen, run.kicked, levels)]


def _bounds(events: Sequence[Event], top: float) -> Bracket:
    """Return what the events bound, the largest motion that lasts being `top`, m."""
    kinds: dict[str, list[Event]] = {'rest': [], 'stayed': [], 'died': [], 'grew': []}
    for event in events:
        kinds[event.kind].append(event)
    why: dict[str, Event] = {}
    kinds['stayed'] = [e for e in kinds['stayed'] if e.amplitude > SMALLEST * top]
    smallest = min((e.amplitude for e in kinds['stayed']), default=math.inf)
    # The fold is no larger than any limit cycle: what is larger than one, and dies, is below it.
    beyond = [e for e in kinds['died'] if e.amplitude >= smallest]
    if beyond:
        why['v_n_above'] = max(beyond, key=lambda e: e.speed_low)
    if kinds['stayed']:
        why['v_n_below'] = min(kinds['stayed'], key=lambda e: e.speed_low)
    resting = [e for e in kinds['rest'] if e.damped]
    resting += [e for e in kinds['died'] if math.isfinite(e.kick)]
    if resting:
        why['v_c_above'] = max(resting, key=lambda e: e.speed_low)
    coexistence = None
    if kinds['stayed']:
        cycle = why['v_n_below']
        if rest := _beside(events, cycle):
            coexistence = (cycle.speed_low, rest.speed_high)
            why |= {'rest': rest, 'stayed': cycle}
    began = min((e.speed_high for e in kinds['grew']), default=None)
    low, high = (
        why[key].speed_low * (1.0 + side * 0.5 * ONE_SPEED) if key in why else None
        for key, side in (('v_n_above', -1.0), ('v_n_below', 1.0))
    )
    if low is not None and high is not None and low >= high:
        # One of them is noise, or another day.
        low, high = None, None
        why.pop('v_n_above'), why.pop('v_n_below')
    v_c = why['v_c_above'].speed_low * (1.0 - 0.5 * ONE_SPEED) if 'v_c_above' in why else None
    unstable = tuple(_unstable(kinds, high))
    return Bracket(tuple(events), (low, high), v_c, began, coexistence, unstable, why)


def _beside(
    events: Sequence[Event], cycle: Event, coexist: Callable[[float], bool] = lambda speed: True
) -> Event | None:
    """Return rest at the highest speed at which it and a limit cycle were seen; or None."""
    resting = [
        e
        for e in events
        # Two states at one speed keep apart; what wanders between them is one.
        if e.kind == 'rest'
        and e.speed_high >= cycle.speed_low
        and e.spread[1] < 0.5 * cycle.spread[0]
        and coexist(e.speed)
    ]
    return max(resting, key=lambda e: e.speed_high, default=None)


def _unstable(
    kinds: dict[str, list[Event]], v_n: float | None
) -> list[tuple[float, float, float]]:
    """Bounds of the unstable amplitude at the speeds at which kicks stayed, or died above v_n."""
    rows: dict[float, tuple[float, float]] = {}
    for event in [*kinds['died'], *kinds['stayed']]:
        if not math.isfinite(event.kick):
            continue
        speed = next(
            (s for s in rows if abs(s / event.speed - 1.0) < ONE_SPEED), round(event.speed, 6)
        )
        above, below = rows.get(speed, (math.nan, math.nan))
        if event.kind == 'stayed':
            below = float(np.nanmin([below, event.kick]))
        elif v_n is not None and event.speed_low >= (1.0 - ONE_SPEED) * v_n:
            above = float(np.nanmax([above, event.amplitude]))
        rows[speed] = above, below
    return sorted(
        (speed, above, below)
        for speed, (above, below) in rows.items()
        if math.isfinite(above) or math.isfinite(below)
    )
