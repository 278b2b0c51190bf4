"""Why each quantity of an identification is not known, in words; `silence` puts it down."""

from __future__ import annotations

from hunt_ros.dynamics.normal_form import COEFFICIENTS
from hunt_ros.identification.days import Days
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
        'v_c': _bounded(linear or no_fold or _FEW_DRAWS, result.days),
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
        **_undated(result.days, no_hysteresis),
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


def _bounded(reason: str, days: Days | None) -> str:
    """Add what free motion says of v_c all the same: it is above any speed of a decay."""
    if days is None:
        return reason
    decay, growth = days.bracket()
    if decay is not None and growth is not None:
        return (
            f'{reason}; free motion still decayed at {decay:.3g} m/s, so that v_c is higher than'
            f' that, and grew from {growth:.3g} m/s on, by its size and the day'
        )
    if decay is not None:
        return f'{reason}; free motion still decayed at {decay:.3g} m/s: v_c is higher than that'
    if growth is not None:
        return (
            f'{reason}; free motion grew from {growth:.3g} m/s on, which large motion does'
            ' below v_c too'
        )
    return reason


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
        'observed.v_c_between_mps': _unbounded(result.days, up),
        'observed.v_n_between_mps': down,
        'observed.step_mps': 'no jump was observed',
    }


def _unbounded(days: Days | None, no_jump: str) -> str:
    """Reason why v_c has no bound on one side, or on both."""
    decay, growth = (None, None) if days is None else days.bracket()
    if decay is None and growth is None:
        return f'{no_jump}, and no free motion at one speed was seen'
    if decay is None:
        return f'{no_jump}, and no free motion at one speed decayed'
    if growth is None:
        return f'{no_jump}, and no free motion at one speed grew'
    return (
        f'free motion grew from {growth:.3g} m/s on, no faster than {decay:.3g} m/s where it'
        ' still decayed: by its size or the day'
    )


def _undated(days: Days | None, no_hysteresis: str) -> dict[str, str]:
    """Reasons for what the days do not show."""
    if days is None:
        return {'days': 'the recordings were not sorted by day'}
    several = len(days.summaries) > 1
    apart = (
        'no two days have measured the limit cycle at the same speeds'
        if several
        else 'all recordings are of one day'
    )
    decayed = 'no free motion at one speed decayed, on some day or on any'
    grew = 'no free motion at one speed grew, on some day or on any'
    return {
        'days.day_std_m': apart,
        'days.summary.shift_m': apart,
        'days.summary.observed_v_c': 'a day without a jump up, speed rising',
        'days.summary.observed_v_n': no_hysteresis or 'a day without a jump down, speed falling',
        'days.summary.highest_decay_mps': decayed,
        'days.summary.lowest_growth_mps': grew,
        'days.highest_decay_mps': decayed,
        'days.lowest_growth_mps': grew,
    }
