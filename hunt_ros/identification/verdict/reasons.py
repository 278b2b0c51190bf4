"""Why an entry of the result is null: of every one, in one place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds
from hunt_ros.dynamics.normal_form import Criticality
from hunt_ros.identification.bracket import Bracket
from hunt_ros.identification.result import reason_in

#: Widths of one step of a staircase differ from it by the noise of the speed reading.
_ONE_STEP = 1.25
#: Lists that say something by being empty.
_LISTS = ('branches', 'steady_states')

_FEW_DRAWS = 'too few of the laws that the data allow have one'
_NO_FOLD = f'no fold of the law lies near the speeds of the data, or {_FEW_DRAWS}'
_NO_JUMP_UP, _NO_JUMP_DOWN = (
    f'no run shows steady states either side of a jump {way}, without a kick'
    for way in ('up, speed rising', 'down, speed falling')
)
_APART = 'rest and a limit cycle were not seen at one speed, or by the law both may not last there'
_NONE_STAYED = 'no motion as large as a limit cycle died, or none stayed'

#: Reasons where no condition of a quantity failed, by the key of the JSON or its beginning.
_USUAL: Mapping[str, str] = {
    **dict.fromkeys(('v_c', 'coefficients', 'criticality', 'normal_form'), _FEW_DRAWS),
    'hysteresis_below': 'some of the laws that the data allow have a hysteresis without end',
    **dict.fromkeys(('v_n', 'fold_amplitude_m', 'hysteresis_width'), _NO_FOLD),
    'disturbance_m': 'the unstable branch does not reach an observed jump up',
    'branches': 'at some speeds the law has no such limit cycle',
    'steady_states.amplitude_std_m': 'some steady states are too short for a deviation',
    'steady_states': 'the mean of the maxima is taken on plateaus only, over two cycles or more',
    'fit.lack_of_fit_p': 'no motion shows whether the law holds, or the fit has run away',
    'fit': 'the fit of the law has not converged',
    'frequency_hz': 'no line stands out',
    'observed.step_mps': 'no jump was observed',
    **dict.fromkeys(('observed.v_n', 'observed.v_n_between_mps'), _NO_JUMP_DOWN),
    'observed.hysteresis_width': 'no run shows a jump up and a jump down, without a kick',
    'observed': _NO_JUMP_UP,
    'bracket.v_c_above_mps': 'no kick died, and no rest was long enough to show its damping',
    'bracket.began_mps': 'nothing grew out of rest unkicked, and stayed',
    'bracket.unstable_amplitude': 'kicks bound it on one side, or on none',
    'bracket.events.undamped_m': 'only rest has one',
    'bracket.events': 'not every motion was kicked',
    'bracket.cycle_ends_between_mps': _NONE_STAYED,
    'bracket.v_n_between_mps': 'no rest was seen beside the cycle, or nothing bounds that side',
    'bracket': _APART,
}


def reasons(
    bracket: Bracket, failed: Mapping[str, str], no_recipe: str, no_hysteresis: str
) -> dict[str, str]:
    """
    Return the reasons that hold for this result, where they are not the usual ones.

    Parameters
    ----------
    bracket : Bracket
        What was seen.
    failed : mapping of str to str
        Key of the JSON -> the first of its conditions that failed, in words; '' for none.
    no_recipe, no_hysteresis : str
        Why there is no four-point recipe, and no v_n and width as observed; '' for none.
    """
    ends = 'observed.v_n', 'observed.v_n_between_mps', 'observed.hysteresis_width'
    told = {**failed, 'four_point': no_recipe, **dict.fromkeys(ends, no_hysteresis)}
    if not bracket.events:
        told['bracket'] = (
            'all amplitudes are of one kind: rest and a limit cycle cannot be told apart'
        )
    return {name: reason for name, reason in told.items() if reason}


def resolved(
    seen: ObservedCriticalSpeeds, criticality: Criticality | None
) -> tuple[ObservedCriticalSpeeds, str]:
    """
    Withhold a hysteresis that the steps of the speed do not show.

    Speeds of jumps are known to half a step. Two jumps one step apart are what a continuous
    onset without any hysteresis gives as well.

    Parameters
    ----------
    seen : ObservedCriticalSpeeds
        As read off.
    criticality : 'subcritical', 'supercritical' or None
        What the fit says of the rig; None where it does not say.

    Returns
    -------
    speeds : ObservedCriticalSpeeds
    reason : str
        Why v_n and the width are not given although the amplitude fell; '' where they are,
        or where it did not fall.
    """
    width, step = seen.hysteresis_width, seen.step
    reason = ''
    if seen.v_n is None:
        return seen, ''
    if criticality == 'supercritical':
        reason = 'the rig is supercritical: its amplitude falls without a jump'
    elif width is not None and step is not None and width < -_ONE_STEP * step:
        reason = (
            f'the amplitude fell at a higher speed than it rose ({-width:.2g} m/s): no hysteresis'
            ' does that'
        )
    elif width is not None and step is not None and width <= _ONE_STEP * step:
        reason = (
            f'the amplitude rose and fell at speeds {width:.2g} m/s apart, no more than one step'
            f' of the speed ({step:.2g} m/s): no hysteresis is resolved'
        )
    return (replace(seen, v_n=None, v_n_between=(None, None)), reason) if reason else (seen, '')


def nulls_of(document: Mapping[str, Any]) -> list[str]:
    """
    Return the keys that are null, or empty where that says something, each once.

    Parameters
    ----------
    document : mapping
        As `Identification.to_json` gives it.
    """
    found = [key for key in _LISTS if not document.get(key, True)]
    return list(dict.fromkeys([*found, *_walk(document, '')]))


def _walk(entry: Any, path: str) -> Iterator[str]:
    """Iterate over the paths of all entries that are None."""
    if entry is None:
        yield path
    elif isinstance(entry, Mapping):
        for key, below in entry.items():
            yield from _walk(below, f'{path}.{key}' if path else str(key))
    elif isinstance(entry, Sequence) and not isinstance(entry, str):
        for below in entry:
            yield from _walk(below, path)


def unknown_of(document: Mapping[str, Any], told: Mapping[str, str]) -> dict[str, str]:
    """
    Say of every null why it is not known.

    Parameters
    ----------
    document : mapping
        As `Identification.to_json` gives it.
    told : mapping of str to str
        Key, or the part of it before a dot -> reason; the longest that fits counts, and before
        the usual ones.

    Returns
    -------
    dict of str to str
        Key -> reason.
    """
    return {
        key: reason_in(told, key) or reason_in(_USUAL, key) or 'the data do not show it'
        for key in nulls_of(document)
    }
