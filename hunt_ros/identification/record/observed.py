"""What the jumps of the amplitude say by themselves, and when they say nothing."""

from __future__ import annotations

from dataclasses import replace

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds
from hunt_ros.dynamics.normal_form import Criticality

#: Widths of one step of a staircase differ from it by the noise of the speed reading.
_ONE_STEP = 1.25


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
    if seen.v_n is None:
        return seen, ''
    width, step = seen.hysteresis_width, seen.step
    reason = ''
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
    if not reason:
        return seen, ''
    return replace(seen, v_n=None, v_n_between=(None, None)), reason
