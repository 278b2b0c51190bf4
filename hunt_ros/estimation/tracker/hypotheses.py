"""
What has happened: nothing but wrong samples, a kick, or a step of the levels.

A surprise is at first each of them. So from then on one filter goes on as before, a copy of it has
the covariance of the modes opened (`open_kick`), another one that of the level
(`open_level`), and each counts the likelihood of what follows: of its innovations, and of
the events that it supposes. The size of an event has a wide prior, so that what opens more must
explain more: the generalised likelihood ratio of Willsky and Jones (IEEE Trans. Autom. Control
21, 1976), with the sizes integrated over instead of maximised. The likeliest filter gives the
estimate meanwhile, with a deviation of the amplitude that holds what the others say
(`block.spread`); one that is left far behind is dropped, and after a hunting period all but the
best. A step of ten times the noise, or more, is told from a kick within a tenth of a second, wrong
samples in two or three.
"""

from __future__ import annotations

import cmath
import math

from hunt_ros.compiled import compiled_part
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.algebra import (
    aim,
    correct,
    expected,
    magnified,
    open_modes,
    project,
    seen_of_lateral,
    slip,
)
from hunt_ros.estimation.tracker.ratio import squared
from hunt_ros.estimation.tracker.tuning import stop_sensor, tune

KICK_QUICK = 0.08  # s, time constant of the in-band burst detector
BURST = 20.0  # power over that of white noise taken for a surprise
OPENED = 5.0  # the covariance opens to this multiple of the innovation
#: Kicks without a pause of so many periods, for longer than one, are none: then the noise of the
#: sensor rises by this factor with each.
SHAPED, NOISIER = 1.2, 1.5
SLIGHT = 0.03  # of the amplitude: a change that needs no opening of the covariance
RESOLVED = 1e8  # power over that of the noise that double precision can still resolve
#: Chance, before anything is seen, that in one bin the rig is kicked, the level of a sensor steps,
#: and that an event of a moment ago goes on. A wheelset that is set aside stands still at first,
#: as a level does: such a kick must not be taken for a step, the other mistake soon mends itself.
KICKED, STEPPED, GOES_ON = 3e-5, 1e-12, 0.3
#: Share of wrong samples: at least and at most, and s over which it is learnt.
WRONG_LEAST, WRONG_MOST, WRONG_TIME = 1e-3, 0.3, 3.0
AGAIN = 0.1  # s for which an event goes on
DROPPED = math.log(1e18)  # behind the likeliest by this much, a hypothesis is given up
BEYOND = 1e8  # power of an innovation over its variance that is no motion, but another signal
NOISY = 1e3  # variance expected over variance found above which the noise is of another time
PATIENCE = 0.02  # s that another signal must last


@compiled_part
def usual(f: at.Filter, k: int) -> float:
    """Variance of the innovations of sensor k over the expected one: 1 if the model is right."""
    # What surprises all the time is no surprise: harmonics, a mode that is not modelled.
    return max(f.sensors[k].nis, 1.0)


@compiled_part
def surprising(f: at.Filter, k: int) -> bool:
    """Return True if the innovation at hand is beyond what noise gives."""
    return f.innovation * f.innovation > at.GATE**2 * usual(f, k) * f.variance


@compiled_part
def gather_burst(f: at.Filter, k: int, dt: float) -> float:
    """
    Add the innovation at hand to the burst, demodulated at the hunting frequency.

    Returns
    -------
    float
        Its power over that of white noise if it is one that needs the covariance opened, else 0.
    """
    sensor, x = f.sensors[k], f.x
    dt = min(dt, 0.05)
    decay = math.exp(-dt / KICK_QUICK)
    step = math.sqrt(1.0 - decay * decay)
    unit = f.innovation / math.sqrt(f.variance)
    turn = decay * cmath.exp(complex(0.0, x[at.OMEGA] * dt))
    sensor.burst = turn * sensor.burst + step * unit
    burst = squared(sensor.burst)
    # A wrong frequency may not keep opening the covariance: give it a second to be learnt.
    if burst <= BURST * usual(f, k) or f.time - f.opened <= 1.0:
        return 0.0
    # A small part of a large motion may come and go without a kick: lines from its nonlinearity.
    z = at.Z + 2 * sensor.coordinate
    slight = SLIGHT * SLIGHT * (x[z] ** 2 + x[z + 1] ** 2) * magnified(f, k)
    if 2.0 * burst * f.variance * dt / KICK_QUICK <= slight:
        return 0.0
    return burst / usual(f, k)


@compiled_part
def seen(f: at.Filter, k: int) -> float:
    """Power of what surprises, in the signal of sensor k."""
    sensor = f.sensors[k]
    return f.innovation * f.innovation + squared(sensor.burst) * sensor.noise


@compiled_part
def begin(f: at.Filter, event: int) -> None:
    """Note what the covariance is opened for."""
    f.event = event
    f.opened = f.time
    for i in range(f.sensor_count):
        f.sensors[i].burst = 0j


@compiled_part
def open_level(f: at.Filter, k: int) -> None:
    """Open the covariance for a step of the level of sensor k."""
    opened = min(OPENED * OPENED * seen(f, k), RESOLVED * f.sensors[k].noise)
    f.P[at.BIAS + k, at.BIAS + k] += opened
    if f.sensors[k].stepped == -math.inf:
        f.sensors[k].stepped = f.time
    begin(f, at.STEP)


@compiled_part
def open_kick(f: at.Filter, k: int) -> None:
    """Open the covariance for a kick seen by sensor k."""
    sensor, x, P = f.sensors[k], f.x, f.P
    size, scale = seen_of_lateral(f, k), seen(f, k)
    open_modes(f, min(OPENED * OPENED * scale, RESOLVED * sensor.noise) / size)
    since = f.time - f.kick
    if since * x[at.OMEGA] > SHAPED * 2.0 * math.pi:
        f.kicks_since = f.time
    if (f.time - f.kicks_since) * x[at.OMEGA] > 2.0 * math.pi:
        # What comes again in each period is the shape of the motion, as where stops cut it off:
        # noise to a filter that follows one frequency.
        sensor.noise *= NOISIER
    elif at.SETTLING < since < 2.0:
        # One comes again at once where the frequency is wrong: each beat looks like a kick.
        P[at.OMEGA, at.OMEGA] = max(P[at.OMEGA, at.OMEGA], at.OMEGA_STD**2)
    power = x[0] * x[0] + x[1] * x[1]
    if scale > 9.0 * power * size:
        # A motion much larger than before: what was learnt from noise is worth little.
        off = x[at.OMEGA] - f.mode.omega
        P[at.OMEGA, at.OMEGA] = max(P[at.OMEGA, at.OMEGA], off * off)
        x[at.GROWTH] = min(max(x[at.GROWTH], -at.GROWTH_STD), at.GROWTH_STD)
    f.kick = f.time
    begin(f, at.KICK)


@compiled_part
def face(f: at.Filter, k: int, mean: float, noise: float) -> None:
    """
    Compare the mean of a bin of sensor k with what the filter expects: innovation and variance.

    `noise` is the variance of the noise in the mean.
    """
    aim(f, k)
    f.noise = noise
    f.innovation = mean - expected(f, f.row.direct)
    f.variance = project(f) + noise
    if not noise <= f.variance < math.inf:
        # Covariance no longer positive: reset it.
        P = f.P
        for i in range(f.states):
            scale = max(abs(P[i, i]), 1e-30)
            for j in range(f.states):
                P[i, j] = 0.0
            P[i, i] = scale if scale < 1e30 else noise
        f.variance = project(f) + noise


@compiled_part
def young(f: at.Filter) -> bool:
    """Return True while the event for which the covariance was opened may go on."""
    return f.event != at.NOTHING and f.time - f.opened < AGAIN


@compiled_part
def goes_on(f: at.Filter, k: int) -> bool:
    """Return True if a surprise of sensor k may be more of what the covariance was opened for."""
    if not young(f):
        return False
    if f.event == at.KICK:
        return True
    # A level steps once; within a bin, so that the next one shows the rest.
    since, spacing = f.time - f.sensors[k].stepped, max(f.cfg.bin, f.sensors[k].spacing)
    return since < 1.5 * spacing or since == math.inf


@compiled_part
def open_for(f: at.Filter, event: int, k: int, mean: float) -> None:
    """Open the covariance for an event that sensor k sees now."""
    noise = f.noise
    if event == at.KICK:
        open_kick(f, k)
    else:
        open_level(f, k)
    face(f, k, mean, noise)


@compiled_part
def suppose(t: at.Tracker, event: int, k: int, mean: float, credit: float) -> None:
    """
    Suppose that an event begins with this bin of sensor k, if not likelier with one before.

    `credit` is the logarithm of the likelihood ratio that the bins before have gathered for it.
    """
    prior = math.log(KICKED if event == at.KICK else STEPPED)
    f, likelihood = t.filters[event], t.filters[0].likelihood + prior + credit
    if f.alive and (credit > 0.0 or f.likelihood >= likelihood):
        return  # a burst is one event, while it lasts
    t.filters[event] = t.filters[0]
    f.likelihood = likelihood
    for i in range(f.sensor_count):
        f.sensors[i].stepped = -math.inf
    open_for(f, event, k, mean)


@compiled_part
def weigh(f: at.Filter, k: int, mean: float, count: float) -> float:
    """Take a bin of sensor k into one filter; return the logarithm of its likelihood by it."""
    sensor = f.sensors[k]
    dt = f.time - sensor.last
    likelihood = 0.0
    if surprising(f, k):
        if not goes_on(f, k):
            return leave_out(f, k, dt)
        likelihood += math.log(GOES_ON)
        open_for(f, f.event, k, mean)
    expects = usual(f, k) * f.variance
    likelihood -= 0.5 * (f.innovation * f.innovation / expects + math.log(expects))
    take(f, k, mean, count, dt)
    return likelihood


@compiled_part
def leave_out(f: at.Filter, k: int, dt: float) -> float:
    """Leave a bin of sensor k out as wrong; return the logarithm of its likelihood if it is."""
    sensor = f.sensors[k]
    share = min(max(sensor.wrong, WRONG_LEAST), WRONG_MOST)
    sensor.wrong += (1.0 - math.exp(-min(dt, 0.05) / WRONG_TIME)) * (1.0 - sensor.wrong)
    wide = OPENED * OPENED * f.innovation * f.innovation
    return math.log(share) - 0.5 * (1.0 / (OPENED * OPENED) + math.log(wide))


@compiled_part
def take(f: at.Filter, k: int, mean: float, count: float, dt: float) -> None:
    """Correct a filter by a bin of sensor k, `dt` seconds after the last one it took."""
    sensor, x = f.sensors[k], f.x
    sensor.wrong *= math.exp(-min(dt, 0.05) / WRONG_TIME)
    sensor.last = f.time
    correct(f, f.innovation, f.variance)
    x[at.OMEGA] = min(max(x[at.OMEGA], f.cfg.omega_min), f.cfg.omega_max)
    x[at.GROWTH] = min(max(x[at.GROWTH], -5.0 * at.GROWTH_STD), 5.0 * at.GROWTH_STD)
    for number in range(f.slip_count):
        furthest = 3.0 * f.slips[number].deviation
        x[slip(f, number)] = min(max(x[slip(f, number)], -furthest), furthest)
    tune(f, k, dt, count)
    sensor.spacing += 0.02 * (min(dt, 0.1) / count - sensor.spacing)
    clean = mean - x[at.BIAS + k] - expected(f, 2 * f.line_count)
    sensor.clean_sum += count * clean
    sensor.clean_count += count


@compiled_part
def another_signal(f: at.Filter, k: int) -> bool:
    """
    Start sensor k anew if its signal is no more the one it was; return True if it was not.

    Such is what no event explains, once it has lasted, and noise that is far less than it was.
    """
    sensor = f.sensors[k]
    if sensor.nis < 1.0 / NOISY:
        stop_sensor(f, k)
        return True
    if f.innovation * f.innovation <= BEYOND * usual(f, k) * f.variance:
        sensor.strange_since = math.inf
        return False
    sensor.strange_since = min(sensor.strange_since, f.time)
    if f.time - sensor.strange_since <= PATIENCE:
        return False
    stop_sensor(f, k)
    return True


@compiled_part
def judge(t: at.Tracker, k: int, mean: float, count: float) -> None:
    """Take the mean of a bin of sensor k, which every filter faces, into all hypotheses."""
    best = t.filters[t.lead]
    if rests_on_trial(t, best) and surprising(best, k) and not young(best):
        settle(t)  # what surprises the best of them is another event
    best = t.filters[t.lead]
    if another_signal(best, k):
        settle(t)
        return
    if best.sensors[k].strange_since < math.inf:  # no event is so large
        for h in range(at.HYPOTHESES):
            if t.filters[h].alive:
                leave_out(t.filters[h], k, t.filters[h].time - t.filters[h].sensors[k].last)
        return
    f = t.filters[0]
    surprised = surprising(f, k)
    credit = 0.0 if surprised else gather_burst(f, k, f.time - f.sensors[k].last)
    # Where the first filter supposes an event by now, the others are what it may have been.
    if (surprised or credit > 0.0) and not goes_on(f, k) and not rests_on_trial(t, f):
        if not trying(t):
            t.since = f.time
        suppose(t, at.KICK, k, mean, credit)
        suppose(t, at.STEP, k, mean, credit)
    for h in range(at.HYPOTHESES):
        if t.filters[h].alive:
            t.filters[h].likelihood += weigh(t.filters[h], k, mean, count)
    compare(t)


@compiled_part
def rests_on_trial(t: at.Tracker, f: at.Filter) -> bool:
    """Return True if a filter supposes an event of the trial that goes on."""
    return trying(t) and f.opened >= t.since


@compiled_part
def trying(t: at.Tracker) -> bool:
    """Return True while more than one hypothesis is tried."""
    return bool(t.filters[at.KICK].alive or t.filters[at.STEP].alive)


@compiled_part
def compare(t: at.Tracker) -> None:
    """Find the likeliest hypothesis; give up those far behind, and all but the best in the end."""
    t.lead = 0
    for h in range(1, at.HYPOTHESES):
        if t.filters[h].alive and t.filters[h].likelihood > t.filters[t.lead].likelihood:
            t.lead = h
    f = t.filters[t.lead]
    least = t.filters[t.lead].likelihood - DROPPED
    for h in range(1, at.HYPOTHESES):
        if t.filters[h].likelihood < least:
            t.filters[h].alive = False
    if t.filters[0].likelihood < least:
        t.filters[0] = f
        f.alive = False
        t.lead = 0
    over = (f.time - t.since) * f.mode.omega > 2.0 * math.pi
    if over or not trying(t):
        settle(t)


@compiled_part
def settle(t: at.Tracker) -> None:
    """Go on with the likeliest hypothesis alone."""
    if t.lead > 0:
        t.filters[0] = t.filters[t.lead]
    t.lead = 0
    for h in range(at.HYPOTHESES):
        t.filters[h].alive = h == 0
        t.filters[h].likelihood = 0.0
