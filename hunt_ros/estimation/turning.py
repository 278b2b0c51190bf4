"""
The turning of a roller: what its angle is, from an encoder, a speed, or both.

Known lines are told apart by their phase in this angle, live and in whole records. Where an
encoder gives it, it is exact; where it is an integrated speed it drifts away from the true one
by the error of the speed, and who uses it must let the phase of the lines wander
(`tracker_config.Shaft.slip_std` live, `identification.turning` in whole records).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import F1, I1, R1, compiled, compiled_part
from hunt_ros.samples import Series

_F = NDArray[np.float64]

#: Where only the speed is known the roller's angle is integrated from it, with a scale that is
#: known to a few parts in a thousand at best, the tachometer's and the diameter: its relative
#: standard deviation, with a margin.
SPEED_STD = 0.01
#: The lines of a roller whose diameter nobody gave lie at least so far above the hunting, or are
#: not taken for known: a diameter that is assumed must not make a line of the hunting itself.
ASSUMED_ABOVE = 1.5

_TURN = 2.0 * math.pi
#: An angle that has covered more than this is one that goes on beyond a turn, rad.
_WITHIN = 1.25 * _TURN
#: The speed is integrated over no longer step than this, s.
_STEP_S = 2.0
#: Time constant with which the ratio of turning and speed is learnt where both are known, s.
_LEARN_S = 20.0

#: A pause between samples that is so many times the longest of late is a gap.
_GAP = 4.0
#: The longest pause of late forgets this share with each sample; the mean rate of turning, too.
_FADES = 0.01
#: No roller turns faster, rad/s: such stamps are those of bursts.
_FASTEST = 1e3
#: Through a gap the roller may have turned by so much less or more than at its mean rate.
_UNSTEADY = 0.3

_U_LAST, _U_STEP, _U_BEFORE, _U_FIRST, _U_LOW, _U_HIGH, _U_ADDED = range(7)
_U_TIME, _U_PAUSE, _U_TURNED, _U_LASTED, _U_TOLD, _N_UNWRAP = range(7, 13)
_A_ANGLE, _A_TOLD, _A_SPEED, _A_TURNED, _A_COVERED, _N_ANGLE = range(6)


class Unwrapping:
    """
    Makes the angle of an encoder that wraps a continuous one.

    A step that is a whole number of turns off the usual one is one of the counter, not of the
    roller. The usual one is the median of the last three: a wrong reading makes two wrong steps,
    one to either side. Of an angle that goes on beyond one turn these are the steps as read, so
    that wrong readings leave nothing behind. Through a gap in the samples the roller turns on at
    its mean rate. Values that are not finite are passed on. Blocks of any size give the same
    numbers, bit for bit.
    """

    def __init__(self) -> None:
        self._memory = np.full(_N_UNWRAP, math.nan)
        self._memory[[_U_ADDED, _U_PAUSE, _U_TURNED, _U_LASTED]] = 0.0
        self._origin_ns: int | None = None

    def update(
        self,
        stamps_ns: NDArray[np.int64],
        angle: _F,
        following_ns: int = 0,
        following: float = math.nan,
    ) -> tuple[_F, float]:
        """
        Take the next samples.

        Parameters
        ----------
        stamps_ns : ndarray of int64, shape (n,)
            When they were read.
        angle : ndarray, shape (n,)
            As read, rad.
        following_ns, following : int, float
            The sample after these, which is not taken in yet.

        Returns
        -------
        angle : ndarray, shape (n,)
            Continuous, rad.
        following : float
            The same of the sample after these.
        """
        if self._origin_ns is None and stamps_ns.size:
            self._origin_ns = int(stamps_ns[0])
        origin_ns = self._origin_ns or 0
        found, after = np.empty(angle.size), np.empty(1)
        time = np.asarray((stamps_ns - origin_ns) * 1e-9, dtype=np.float64)
        _unwrap(time, np.ascontiguousarray(angle, dtype=np.float64), self._memory, found)
        then: _F = np.array([(following_ns - origin_ns) * 1e-9])
        _unwrap(then, np.array([following]), self._memory.copy(), after)
        return found, float(after[0])


@compiled
def _unwrap(time: F1, angle: F1, m: F1, found: F1) -> None:
    """Make an encoder that falls back at each turn continuous."""
    for i in range(angle.size):
        value = angle[i]
        if not math.isfinite(value):
            found[i] = value
            continue
        pause = time[i] - m[_U_TIME]
        if math.isnan(m[_U_LAST]):
            m[_U_LOW] = m[_U_HIGH] = value
        elif pause > _GAP * m[_U_PAUSE] > 0.0 and abs(m[_U_TURNED]) < _FASTEST * m[_U_LASTED]:
            _through_gap(value, pause, m)
        else:
            _follow(value, m)
            m[_U_PAUSE] = max(pause, (1.0 - _FADES) * m[_U_PAUSE])
            m[_U_TURNED] = (1.0 - _FADES) * m[_U_TURNED] + (value + m[_U_ADDED] - m[_U_TOLD])
            m[_U_LASTED] = (1.0 - _FADES) * m[_U_LASTED] + pause
        m[_U_TIME], m[_U_LAST], m[_U_TOLD] = time[i], value, value + m[_U_ADDED]
        found[i] = m[_U_TOLD]


@compiled_part
def _follow(value: float, m: _F) -> None:
    """Count the turns of the encoder's counter between two samples."""
    if value == m[_U_LAST]:
        return
    known = m[_U_HIGH] - m[_U_LOW] > _WITHIN
    m[_U_LOW], m[_U_HIGH] = min(m[_U_LOW], value), max(m[_U_HIGH], value)
    step = value - m[_U_LAST]
    # The first step beyond one turn says that the angle does not wrap there.
    first = not known and m[_U_HIGH] - m[_U_LOW] > _WITHIN and abs(step) < _TURN
    if not first:
        turns = math.floor((step - _usual(m)) / _TURN + 0.5)
        m[_U_ADDED] -= _TURN * turns
        step -= 0.0 if known else _TURN * turns
    m[_U_FIRST], m[_U_BEFORE], m[_U_STEP] = m[_U_BEFORE], m[_U_STEP], step


@compiled_part
def _through_gap(value: float, pause: float, m: _F) -> None:
    """Count the turns where samples are missing; the usual step stays what it was."""
    expected = m[_U_TURNED] / m[_U_LASTED] * pause
    off = value - m[_U_LAST] - expected
    m[_U_LOW], m[_U_HIGH] = min(m[_U_LOW], value), max(m[_U_HIGH], value)
    beyond = m[_U_HIGH] - m[_U_LOW] > _WITHIN
    # What the roller may really have done is believed: an angle that goes on does not wrap.
    if not beyond or abs(off) > 0.5 * _TURN + _UNSTEADY * abs(expected):
        m[_U_ADDED] -= _TURN * math.floor(off / _TURN + 0.5)
    m[_U_PAUSE] = pause  # samples that are rarer from now on are no gaps


@compiled_part
def _usual(m: _F) -> float:
    """Return the median of the last three steps; of fewer the last, 0 where there is none."""
    last, before, first = m[_U_STEP], m[_U_BEFORE], m[_U_FIRST]
    if math.isnan(first):
        return 0.0 if math.isnan(last) else float(last)
    return float(max(min(last, before), min(max(last, before), first)))


def unwrapped(encoder: Series) -> _F:
    """Return the readings of an encoder as a continuous angle, rad, shape (n,)."""
    return Unwrapping().update(encoder.stamps_ns, encoder.values)[0]


def continuous(encoder: Series) -> Series:
    """
    Return a whole recording of an encoder as a continuous angle, rad.

    A reading that repeats the one before is left out: a coarse encoder tells the angle where it
    changes, and between its steps the roller turns on.
    """
    angle = unwrapped(encoder)
    told = np.diff(angle, prepend=math.nan) != 0.0
    told[-1:] = True
    return Series(encoder.stamps_ns[told], angle[told])


class TurningAngle:
    """
    Angle of the roller at any stamp: of its encoder, and where that is silent by the speed.

    Parameters
    ----------
    diameter_m : float
        Of the roller, m. Where encoder and speed are both known their ratio is learnt, and
        takes its place.

    Notes
    -----
    Where the encoder is known the angle is its own, to the last bit. A coarse encoder leaves the
    angle to the speed as long as that stays within its steps. Stamps that do not increase
    repeat the angle. Blocks of any size give the same numbers, bit for bit.
    """

    def __init__(self, diameter_m: float) -> None:
        self._ratio = 2.0 / diameter_m
        self._memory = np.full(_N_ANGLE, math.nan)
        self._memory[[_A_TURNED, _A_COVERED]] = 0.0
        self._last_ns = np.zeros(1, dtype=np.int64)

    def update(
        self, stamps_ns: NDArray[np.int64], encoder: _F, speed: _F, within: _F | None = None
    ) -> _F:
        """
        Return the angle, rad, NaN where neither encoder nor speed is known.

        Parameters
        ----------
        stamps_ns : ndarray of int64, shape (n,)
            Sorted, none before those of earlier calls.
        encoder, speed : ndarray, shape (n,)
            Continuous angle, rad, and running speed, m/s; NaN where not known.
        within : ndarray, shape (n,), optional
            How far the encoder's angle may be off, rad; None: it is exact.
        """
        angle = np.empty(stamps_ns.size)
        off = np.zeros(stamps_ns.size) if within is None else within
        _turn(stamps_ns, encoder, off, speed, self._ratio, self._memory, self._last_ns, angle)
        return angle


@compiled
def _turn(
    stamps: I1,
    encoder: R1,
    within: R1,
    speed: R1,
    ratio: float,
    m: F1,
    last: I1,
    angle: F1,
) -> None:
    """Fill in the angle: the encoder's, and where it is silent what the speed adds to it."""
    for i in range(stamps.size):
        dt = (stamps[i] - last[0]) * 1e-9
        if dt <= 0.0 and math.isfinite(m[_A_ANGLE]):
            angle[i] = m[_A_ANGLE]
            continue
        last[0] = stamps[i]
        way = 0.5 * (speed[i] + m[_A_SPEED]) * dt if dt <= _STEP_S else math.nan
        turned = encoder[i] - m[_A_TOLD]
        if math.isfinite(turned) and math.isfinite(way):
            keep = math.exp(-dt / _LEARN_S)
            m[_A_TURNED] = keep * m[_A_TURNED] + turned
            m[_A_COVERED] = keep * m[_A_COVERED] + way
        turning = math.copysign(ratio, m[_A_TURNED])
        if abs(m[_A_TURNED]) > _TURN and m[_A_COVERED] > 0.0:
            turning = m[_A_TURNED] / m[_A_COVERED]
        moved = m[_A_ANGLE] + turning * way
        if math.isfinite(encoder[i]):
            m[_A_ANGLE] = encoder[i]
            if within[i] > 0.0 and math.isfinite(moved):
                m[_A_ANGLE] = min(max(moved, encoder[i] - within[i]), encoder[i] + within[i])
        elif math.isnan(m[_A_ANGLE]) and math.isfinite(speed[i]):
            m[_A_ANGLE] = 0.0
        else:
            m[_A_ANGLE] = moved
        m[_A_TOLD] = encoder[i]
        m[_A_SPEED] = speed[i]
        angle[i] = m[_A_ANGLE]
