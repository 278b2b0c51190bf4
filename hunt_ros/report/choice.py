"""
Which of the measured steady states Figs. 5 and 7 look at.

The paper takes four: well below the hysteresis region, inside it on the way up, the
highest speed, and inside it on the way down, at the speed of the second one.
"""

from __future__ import annotations

from collections.abc import Sequence

from hunt_ros.analysis.steady_state import SteadyState

#: Two states at one speed differ by no more than this, m/s; the paper's speed meter
#: resolves 0.2 m/s.
_SAME_SPEED = 0.1
#: A state is settled where its amplitude is known to this share of itself.
_SETTLED = 0.1
#: Plateaus at fewer speeds than this are the ends of a sweep.
_FEWEST_SPEEDS = 4
#: Hunting on the way down is at least so many times the quiet motion on the way up.
_HYSTERESIS_RATIO = 3.0


def four_states(states: Sequence[SteadyState]) -> list[SteadyState]:
    """
    Choose the states of Fig. 5.

    Parameters
    ----------
    states : sequence of SteadyState
        All that were measured.

    Returns
    -------
    list of SteadyState
        (a) the lowest speed, (b) up and (d) down at one speed in the middle of the
        hysteresis region, (c) the highest speed, in the order a, b, c, d. Without a
        hysteresis region four speeds spread evenly; fewer where fewer were measured.
    """
    usable = _usable(states)
    if len(usable) <= 4:
        return usable
    pairs = _hysteresis_pairs(usable)
    if pairs:
        low, high = pairs[len(pairs) // 2]
        return [usable[0], low, usable[-1], high]
    return [usable[round(k * (len(usable) - 1) / 3)] for k in range(4)]


def either_side(states: Sequence[SteadyState], v_c: float | None) -> list[SteadyState]:
    """
    Choose the states of Fig. 7: the last below v_c and the first above it, speed up.

    Parameters
    ----------
    states : sequence of SteadyState
        All that were measured.
    v_c : float or None
        As read off the jump, or of the normal form, m/s.

    Returns
    -------
    list of SteadyState
        The two; empty without v_c, or where nothing was measured on one side of it.
    """
    if v_c is None:
        return []
    usable = [state for state in _usable(states) if state.direction != 'down']
    below = [state for state in usable if state.speed < v_c]
    # A plateau on which the jump itself happened shows neither the one nor the other.
    above = [x for x in usable if x.speed >= v_c and x.amplitude_std <= _SETTLED * x.amplitude]
    return [below[-1], above[0]] if below and above else []


def _usable(states: Sequence[SteadyState]) -> list[SteadyState]:
    """Plateaus by speed; along a sweep, which has few of them, the ramps too."""
    plateaus = [state for state in states if state.kind == 'plateau']
    distinct = {round(state.speed / _SAME_SPEED) for state in plateaus}
    chosen = plateaus if len(distinct) >= _FEWEST_SPEEDS else list(states)
    return sorted(chosen, key=lambda state: state.speed)


def _hysteresis_pairs(states: Sequence[SteadyState]) -> list[tuple[SteadyState, SteadyState]]:
    """Pairs at one speed of which the one on the way down hunts, by speed."""
    pairs = []
    ups, downs = ([one for one in states if one.direction == way] for way in ('up', 'down'))
    for low in ups:
        partners = [
            high
            for high in downs
            if abs(high.speed - low.speed) <= _SAME_SPEED
            and high.amplitude > _HYSTERESIS_RATIO * low.amplitude
        ]
        if partners:
            pairs.append((low, min(partners, key=lambda high: abs(high.speed - low.speed))))
    return pairs
