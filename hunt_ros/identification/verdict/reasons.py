"""Why each quantity of an identification is not known, in words; `silence` puts it down."""

from __future__ import annotations

from hunt_ros.dynamics.normal_form import COEFFICIENTS
from hunt_ros.identification.result import Identification
from hunt_ros.identification.verdict.guards import Support

_FEW_DRAWS = 'too few of the laws that the data allow have one'


def reasons_of(
    result: Identification,
    support: Support,
    no_fold: str,
    no_recipe: str,
    no_hysteresis: str = '',
) -> dict[str, str]:
    """
    Collect the reasons why what is null in a result is null.

    Parameters
    ----------
    result : Identification
        Whose nulls are to be explained.
    support : Support
        What the data support.
    no_fold : str
        Why the law is not believed; '' where it is.
    no_recipe : str
        Why there is no four-point recipe; '' where there is one.
    no_hysteresis : str
        Why a fall of the amplitude is not given as observed v_n; '' where it is.

    Returns
    -------
    dict of str to str
        Key of the JSON, or its beginning -> reason; keys that are known may stand in it.
    """
    linear = support.reason('critical')
    whole = support.reason('critical', 'time', 'cubic') or no_fold
    fold = support.reason('critical', 'time', 'cubic', 'nonlinear', 'complete') or no_fold
    if result.criticality is None:
        fold = whole
    fold = fold or f'no fold of the law lies near the speeds of the data, or {_FEW_DRAWS}'
    why = {
        'v_c': linear or no_fold or _FEW_DRAWS,
        'v_n': fold,
        'hysteresis_width': fold,
        'fold_amplitude_m': fold,
        'correlations': whole or 'no normal form is given',
        'criticality': whole,
        'branches': whole,
        'four_point': no_recipe,
        'disturbance_m': _no_disturbance(result, fold),
        'steady_states': 'no stretch holds its amplitude for long enough',
        **_unobserved(result, no_hysteresis),
        **_unseen(result),
    }
    if not result.branches:
        # Not at some speeds: nowhere.
        why |= {'branches.stable_amplitude_m': whole, 'branches.unstable_amplitude_m': whole}
    else:
        why.pop('branches')
    if result.steady_states:
        why.pop('steady_states')
    for name in COEFFICIENTS:
        names = ('critical', 'time') if name in ('D1', 'D7') else ('critical', 'time', 'cubic')
        lack = support.reason(*names) or no_fold
        why[f'coefficients.{name}'] = lack or f'the law has no normal form, or {_FEW_DRAWS}'
    return {key: reason for key, reason in why.items() if reason}


def _no_disturbance(result: Identification, fold: str) -> str:
    if result.v_n is None:
        return fold
    if result.observed.v_c is None:
        return 'no jump up was observed, speed rising'
    return f'the unstable branch does not reach {result.observed.v_c:.3g} m/s, the observed jump'


def _unobserved(result: Identification, no_hysteresis: str) -> dict[str, str]:
    """Return why what runs show by themselves is not known."""
    observed = result.observed
    if observed.threshold is None:
        reason = 'all amplitudes are of one kind: nothing jumped'
        return {'observed': reason}
    jump = 'no run shows steady states either side of a jump {0}, speed {1}, without a kick'
    up, down = jump.format('up', 'rising'), jump.format('down', 'falling')
    down = no_hysteresis or down
    return {
        'observed.v_c': up,
        'observed.v_n': down,
        'observed.hysteresis_width': up if observed.v_c is None else down,
        'observed.v_c_between_mps': up,
        'observed.v_n_between_mps': down,
        'observed.step_mps': 'no jump was observed',
    }


def _unseen(result: Identification) -> dict[str, str]:
    """Return why what is seen without a model bounds a quantity on one side only, or not."""
    if not result.bracket.events:
        none = 'all amplitudes are of one kind: rest and a limit cycle cannot be told apart'
        return {'bracket': none}
    apart = 'rest and a limit cycle were not seen at one speed'
    none_stayed = 'no motion as large as a limit cycle died, or none stayed'
    return {
        'bracket.criticality': apart,
        'bracket.coexistence_mps': apart,
        'bracket.v_n_between_mps': none_stayed if result.bracket.coexistence else apart,
        'bracket.cycle_ends_between_mps': none_stayed,
        'bracket.v_c_above_mps': 'rest was not seen for long at one speed',
        'bracket.began_mps': 'nothing grew out of rest unkicked, and stayed',
        'bracket.unstable_amplitude': 'kicks bound it on one side, or on none',
        'bracket.events': 'not every motion was kicked',
    }
