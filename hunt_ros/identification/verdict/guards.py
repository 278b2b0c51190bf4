"""
What the data support, and what they do not: the guards before any number is given.

Nothing is reported because a fit returned it. Each quantity needs motion that shows it:
a critical speed needs several speeds, a time scale needs free motion, an unstable branch
needs amplitudes on both sides of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hunt_ros.analysis.steady_state import hunting_threshold
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.identification.fit import FittedLaw
from hunt_ros.identification.growth_law import GrowthLaw
from hunt_ros.identification.posterior import Posterior
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.identification.record.segments import Segment
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.identification.uncertainty import robust_covariance

#: Relative range of speeds below which a record is one at one speed.
_ONE_SPEED = 0.02
#: Largest relative deviation of v_c that still is knowledge of it.
_VAGUE_SPEED = 0.1
#: Largest relative deviation at which a coefficient's sign is known.
_VAGUE = 0.5
#: A limit cycle so many times larger than what was measured was not seen.
_BEYOND = 1.1
#: Share of the laws that the data allow in which a thing must be so, to be said.
SURE = 0.8
#: Cycles of free motion below which a record is too short for anything.
_FEWEST_STEPS = 12


@dataclass(frozen=True)
class Support:
    """
    What can be known.

    Parameters
    ----------
    critical, cubic, nonlinear, complete : bool
        v_c; the cubic coefficient and its sign; fold and unstable branch; a whole form.
    time : bool
        The time scale: D1 and with it every coefficient.
    reasons : tuple of str
        Why what is not known is not.
    why : mapping of str to str
        The same by name: 'critical', 'time', 'cubic', 'nonlinear', 'complete'.
    """

    critical: bool
    time: bool
    cubic: bool
    nonlinear: bool
    complete: bool
    reasons: tuple[str, ...]
    why: Mapping[str, str] = field(default_factory=dict)

    def knows(self, name: str) -> bool:
        """Whether a coefficient may be given."""
        if name in ('D1', 'D7'):
            return self.critical and self.time
        return self.critical and self.time and self.cubic

    def reason(self, *names: str) -> str:
        """Return why the first of these that is not known is not; '' where all are."""
        return next((self.why[name] for name in names if name in self.why), '')


def support_of(
    best: FittedLaw,
    posterior: Posterior,
    segments: Sequence[Segment],
    envelopes: Sequence[Envelope],
    settings: IdentificationSettings,
) -> Support:
    """
    Judge what the data support.

    Parameters
    ----------
    best : FittedLaw
        The law with the most evidence.
    posterior : Posterior
        The laws that the data leave open.
    segments, envelopes : sequences
        What was seen.
    settings : IdentificationSettings
        For priors, which can stand in for data.

    Returns
    -------
    Support
    """
    reasons: list[str] = []
    forms = posterior.forms
    speed = np.concatenate([envelope.speed for envelope in envelopes])
    amplitude = np.concatenate([envelope.amplitude for envelope in envelopes])
    low, high = float(speed.min()), float(speed.max())
    several = high - low > _ONE_SPEED * float(np.median(speed))
    if not several:
        reasons.append(
            f'one speed only ({np.median(speed):.3g} m/s;'
            f' {_growth_there(best, float(np.median(speed)), len(envelopes))}): v_c and the'
            ' coefficients cannot be known'
        )
    enough = int(np.isfinite(amplitude).sum()) >= _FEWEST_STEPS
    if not enough:
        reasons.append('too short: fewer than a few dozen hunting cycles')
    critical = several and enough and _critical(best, forms, (low, high), settings, reasons)
    why: dict[str, str] = {}
    if not critical:
        why['critical'] = reasons[-1]
    # A state of its own, or the top of a transient: both show what hunting is.
    hunts = hunting_threshold(amplitude) is not None
    if not hunts:
        why['cubic'] = (
            'all amplitudes are of one kind: no passage between quiet and hunting, so that the'
            ' nonlinear coefficients cannot be known'
        )
        reasons.append(why['cubic'])
    moved = any(segment.kind == 'transient' for segment in segments)
    time = moved or settings.prior_D1 is not None or _quiet_motion(forms)
    if hunts and not moved:
        reasons.append('no free transient: the time scale rests on the prior or on quiet motion')
    if not time:
        why['time'] = 'D1 cannot be known; give it with --prior-D1'
        reasons.append(why['time'])
    cubic = critical and time and hunts and _cubic(forms, reasons)
    if critical and time and hunts and not cubic:
        why['cubic'] = reasons[-1]
    nonlinear = cubic and best.law.criticality == 'subcritical' and moved
    if cubic and best.law.criticality == 'supercritical':
        why['nonlinear'] = 'a supercritical rig has no fold and no unstable branch'
    elif cubic and not moved:
        why['nonlinear'] = 'no free transient: none passed by the unstable branch'
    top = float(np.nanmax(amplitude))
    limited = _limited(posterior, (low, high), top, reasons) if cubic else False
    if cubic and not limited:
        why['complete'] = reasons[-1]
    if cubic:
        _second_hopf(best, (low, high), reasons)
    return Support(
        critical, time, cubic, nonlinear and limited, cubic and limited, tuple(reasons), why
    )


def _share(forms: Sequence[NormalForm | None], name: str) -> tuple[float, float]:
    """Median and half the central 68 % of one attribute over the draws that have it."""
    values = [getattr(form, name) for form in forms if form is not None]
    if len(values) < SURE * len(forms) or not values:
        return math.nan, math.inf
    low, middle, high = np.percentile(values, [15.87, 50.0, 84.13])
    return float(middle), 0.5 * float(high - low)


def _growth_there(best: FittedLaw, speed: float, runs: int) -> str:
    """Linear growth rate at one speed, where the motion shows its sign; or that it does not."""
    u = float(best.law.detuning(speed))
    rate = float(best.law.linear(best.law.detuning(speed)))
    slopes = best.law.linear_terms(u)
    variance = float(slopes @ robust_covariance(best.fit, runs).matrix @ slopes)
    if not variance < (_VAGUE * rate) ** 2:
        return 'this motion does not show its linear growth rate'
    return f'linear growth rate {rate:.2g} +/- {math.sqrt(variance):.1g} 1/s'


def _critical(
    best: FittedLaw,
    forms: Sequence[NormalForm | None],
    speeds: tuple[float, float],
    settings: IdentificationSettings,
    reasons: list[str],
) -> bool:
    """Whether v_c is known: it exists, in most draws, near the data, and not vaguely."""
    v_c = best.law.critical_speed
    if v_c is None:
        reasons.append('the linear growth rate nowhere rises through zero: v_c is not known')
        return False
    middle, std = _share(forms, 'critical_speed')
    if not math.isfinite(middle) or std > _VAGUE_SPEED * v_c:
        reasons.append('v_c is not determined by these data')
        return False
    low, high = speeds
    reach = 0.5 * (high - low)
    if not low - reach <= v_c <= high + reach and settings.prior_v_c is None:
        side = 'above' if v_c > high else 'below'
        reasons.append(
            f'v_c would lie far {side} the speeds of the data ({low:.3g} to {high:.3g} m/s):'
            ' it is not given'
        )
        return False
    if not low <= v_c <= high:
        reasons.append(
            f'v_c = {v_c:.3g} m/s is a forecast: the data '
            + (f'end at {high:.3g} m/s' if v_c > high else f'begin at {low:.3g} m/s')
        )
    return True


def _quiet_motion(forms: Sequence[NormalForm | None]) -> bool:
    """Whether the random motion of the quiet state alone shows how fast it is damped."""
    middle, std = _share(forms, 'D1')
    return math.isfinite(middle) and std < 0.3 * abs(middle)


def _cubic(forms: Sequence[NormalForm | None], reasons: list[str]) -> bool:
    """Whether the sign of the cubic coefficient is known."""
    middle, std = _share(forms, 'D4')
    if not std < _VAGUE * abs(middle):
        reasons.append('the fit does not determine D4, not even its sign')
        return False
    return True


def _limited(
    posterior: Posterior, speeds: tuple[float, float], top: float, reasons: list[str]
) -> bool:
    """Whether the growth ends by itself, inside the range of the data: in the laws drawn."""
    law = posterior.law
    if law.criticality == 'supercritical':
        return True
    size, sizes = _limit(law, speeds), np.array([_limit(x, speeds) for x in posterior.drawn])
    share = float(np.isfinite(sizes).mean())
    if size > _BEYOND * top:
        reasons.append(
            f'the limit cycle ({size:.2g} m at v_c) is a forecast: no amplitude above {top:.2g} m'
            ' was measured'
        )
    if not math.isfinite(size) or share < SURE:
        reasons.append(
            f'nothing ends the growth at v_c in {100.0 * (1.0 - share):.0f} % of the laws that the'
            f' data allow{"" if math.isfinite(size) else ", the likeliest among them"}: no normal'
            ' form is given'
        )
        return False
    return True


def _limit(law: GrowthLaw, speeds: tuple[float, float]) -> float:
    """Amplitude of the stable limit cycle at v_c, or where the data end before, m; or NaN."""
    v_c = law.critical_speed
    at = speeds[1] if v_c is None else min(v_c, speeds[1])
    return float(law.steady_amplitudes(at)[1][0])


def _second_hopf(best: FittedLaw, speeds: tuple[float, float], reasons: list[str]) -> None:
    """Warn where the parabola of the linear growth rate turns round inside the data."""
    other = best.law.other_root
    if other is not None and speeds[0] < other < speeds[1]:
        reasons.append(
            f'the fitted linear growth rate has a second zero at {other:.3g} m/s, inside the'
            f' speeds of the data: D7 is not to be trusted'
        )
