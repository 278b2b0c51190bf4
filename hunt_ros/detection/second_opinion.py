"""
The second opinion on the amplitude: the Hilbert envelope of the readings against the filter.

It takes nothing from the filter but the numbers that it judges: the readings are averaged over the
rows, and known lines are taken out by adaptive noise cancelling (Widrow et al., Proc. IEEE 63,
1975, 1692-1716), a notch whose phasors follow the angle of the roller.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, F1, F2, HAVE_COMPILER, R1, compiled, compiled_part
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.estimation.hilbert import HilbertEnvelope
from hunt_ros.records import zeros

_F = NDArray[np.float64]

#: The two estimates disagree beyond this many standard deviations, and beyond this share of the
#: amplitude: what the band-pass leaves of a changing amplitude is less.
_SIGMA, _SHARE = 4.0, 0.15
#: The phasors of the lines, and the noise, are means over so many periods of the hunting.
_PERIODS = 10.0
#: What the hunting left in a phasor at the start is forgotten after so many of these times.
_SETTLED = 3.0
#: A sensor shows nothing any more where, beyond white noise, its readings have less than this part
#: of the power of the lines that were learnt, and no more than so many times the power of that
#: noise, while the roller turns as fast as it did to within this part. Nothing is known of a line
#: whose phasor moves by more than this part of its power: it beats with a motion beside it.
_VANISHED, _WHITE, _STEADY, _WOBBLE = 0.25, 2.0, 0.1, 0.03
#: Frequencies at which the gain of the envelope is tabulated.
_FREQUENCIES = 400


class _Lines:
    """What is known of the readings of a sensor and of their lines; `compiled` has its memory."""

    rows: float  # that were taken in
    offset: float  # mean of the readings
    before: Annotated[_F, 3]  # the last of them
    noise: float  # its variance
    power: float  # mean square of the readings over a period, without their mean
    white: float  # variance of the noise over a period
    wobble: float  # mean square of what the phasors move about their means
    turning: float  # turns per second over the memory
    gone: bool  # the lines have vanished


class SecondOpinion:
    """
    Envelope of one sensor's readings, compared with the filter's amplitude.

    The envelope is half a filter length late, so it is compared with what the filter said then:
    with that amplitude as the row means and the band-pass pass it on at that frequency, give or
    take what they let through of its image at the negative frequency, and what a notch beside it
    takes from it. While the speed changes the notches lag behind the lines: then it is compared
    with hunting and lines together.

    Parameters
    ----------
    config : DetectorConfig
        Band and rate.
    orders : sequence of float
        Of the lines, in turns of the roller.
    """

    def __init__(self, config: DetectorConfig, orders: Sequence[float] = ()) -> None:
        self._rate = 1e9 / config.period_ns
        # An octave below the nominal frequency; lower would make the filter longer and later.
        low = max(config.followed_hz[0], 0.5 * config.hunting_frequency_hz)
        high = min(config.followed_hz[1], 0.45 * self._rate)
        self._envelope = HilbertEnvelope(self._rate, low, high, max(0.8, 1.05 / low))
        self._period_ns = config.period_ns
        self._late = round(self._envelope.delay_s * self._rate)
        self._orders = np.array(orders, dtype=np.float64)
        self._memory = _PERIODS * self._rate / config.hunting_frequency_hz
        self._grid = np.linspace(0.0, 0.5 * self._rate, _FREQUENCIES)
        self._gains = self._envelope.gain(self._grid), self._envelope.gain(-self._grid)
        self._phasors = np.zeros((len(orders), 4))
        self._last_ns: int | None = None
        self._start_again(math.nan)

    def _start_again(self, offset: float) -> None:
        """Begin anew behind missing rows, from the mean and the lines that there were before."""
        self._envelope.reset()
        # What the envelope is to be compared with, for as many rows as it is late.
        self._said = np.full((4, self._late), np.nan)
        self._lines = zeros(_Lines, HAVE_COMPILER)
        self._lines.offset = offset

    def update(
        self,
        rows_ns: NDArray[np.int64],
        stamps_ns: NDArray[np.int64],
        values: _F,
        angle: _F,
        turning: _F,
        said: tuple[_F, _F, _F, _F],
    ) -> tuple[_F, NDArray[np.bool_], NDArray[np.bool_]]:
        """
        Take rows of the filter, and the readings that they were made of.

        Parameters
        ----------
        rows_ns : ndarray of int64, shape (m,)
            Stamps of the rows.
        stamps_ns, values : ndarray, shape (n,)
            Readings since the last row before, in the unit of the sensor.
        angle, turning : ndarray, shape (m,)
            Angle of the roller, rad, and its turns per second; NaN where unknown.
        said : tuple of ndarray, shape (m,)
            Amplitude, its standard deviation, frequency (Hz) and, while the speed changes, the
            amplitude of the lines, by the filter.

        Returns
        -------
        envelope : ndarray, shape (m,)
            That of the time half a filter length before each row; NaN where unknown.
        disagree : ndarray of bool, shape (m,)
            True where the two differ by more than their uncertainty allows.
        gone : ndarray of bool, shape (m,)
            True where the readings do not show the lines any more that they had.
        """
        size = rows_ns.size
        envelope, disagree = np.empty(size), np.zeros(size, dtype=np.bool_)
        gone = np.zeros(size, dtype=np.bool_)
        if not size:
            return envelope, disagree, gone
        noise = np.empty(size)
        row = np.searchsorted(rows_ns, stamps_ns)  # the first that is not before the reading
        row, values = row[row < size], values[row < size]
        count = np.bincount(row, minlength=size)
        sums = np.bincount(row, values, size)
        means = np.divide(sums, count, out=np.full(size, math.nan), where=count > 0)
        steps = np.diff(rows_ns, prepend=rows_ns[0] if self._last_ns is None else self._last_ns)
        cuts = np.flatnonzero(steps > self._period_ns).tolist()
        for begin, end in zip([0, *cuts], [*cuts, size], strict=True):
            if begin in cuts:
                self._start_again(self._lines.offset)
            part = slice(begin, end)
            known = self._orders, self._memory, self._lines, self._phasors
            _take_out(means[part], angle[part], turning[part], *known, noise[part], gone[part])
            envelope[part] = self._envelope.update(means[part])
            self._say(count[part], turning[part], *(column[part] for column in said))
            disagree[part] = self._differ(envelope[part], self._envelope.noise_gain * noise[part])
        self._last_ns = int(rows_ns[-1])
        return envelope, disagree, gone

    def _say(
        self, count: NDArray[np.int64], turning: _F, amplitude: _F, std: _F, hz: _F, beside: _F
    ) -> None:
        """Keep what the envelope of rows of so many readings will be compared with."""
        width = self._rate / (math.pi * self._memory)
        away = np.abs(hz - np.multiply.outer(self._orders, turning))
        near = np.fmin.reduce(away, axis=0, initial=math.inf)
        taken = width / np.fmax(near, 1e-3 * width)
        # Mean of n samples over a row: sin(x) / (n sin(x / n)), x = pi f T.
        turn, n = np.fmax(math.pi * hz / self._rate, 1e-9), np.fmax(count, 1)
        mean = np.sin(turn) / (n * np.sin(turn / n))
        passed, image = (mean * np.interp(hz, self._grid, gain) for gain in self._gains)
        then = passed * amplitude
        said = then, passed * std, image * amplitude + beside, (_SHARE + taken) * then
        self._said = np.concatenate([self._said, np.stack(said)], axis=1)

    def _differ(self, envelope: _F, noise: _F) -> NDArray[np.bool_]:
        """Compare the envelope of each row with what the filter said then; NaN: nothing."""
        then, deviation, beside, share = self._said[:, : envelope.size]
        self._said = self._said[:, envelope.size :]
        away = np.abs(envelope - then) - beside
        spread = np.maximum(_SIGMA * np.hypot(deviation, noise), share)
        differs: NDArray[np.bool_] = away > spread
        return differs


@compiled
def _take_out(
    values: F1,
    angle: R1,
    turning: R1,
    orders: F1,
    memory: float,
    lines: _Lines,
    phasors: F2,
    noise: F1,
    gone: B1,
) -> None:
    """
    Take mean and lines out of the values of rows, NaN: none; fill in the deviation of their noise.

    White noise of variance s^2 has third differences of 20 s^2, a slow motion has none. Of each
    phasor: its parts, and their means over the memory.
    """
    for i in range(values.size):
        value = values[i]
        if math.isfinite(value):
            lines.rows = min(lines.rows + 1.0, _SETTLED * memory)
            seen = min(lines.rows, memory)
            last = lines.before
            third = value - 3.0 * last[0] + 3.0 * last[1] - last[2]
            last[2], last[1], last[0] = last[1], last[0], value
            white = third * third / 20.0 if lines.rows > 3.0 else math.nan
            if math.isnan(lines.offset):  # a sensor reads far from 0 at rest
                lines.offset = value
            if math.isfinite(white):
                lines.noise += (white - lines.noise) / seen
            value -= lines.offset
            _look_for_lines(value, white, turning[i], memory, lines, phasors)
            for k in range(orders.size if math.isfinite(angle[i]) else 0):
                turn = orders[k] * angle[i]
                value -= phasors[k, 0] * math.cos(turn) + phasors[k, 1] * math.sin(turn)
            # As a mean over what there is at first: over a tenth of the memory at least.
            gain = 2.0 * value / (seen + 0.1 * memory)
            lines.offset += 0.5 * gain
            for k in range(orders.size if math.isfinite(angle[i]) and not lines.gone else 0):
                phasors[k, 0] += gain * math.cos(orders[k] * angle[i])
                phasors[k, 1] += gain * math.sin(orders[k] * angle[i])
            values[i] = value
        noise[i] = math.sqrt(lines.noise) if lines.rows >= _SETTLED * memory else math.nan
        gone[i] = lines.gone


@compiled_part
def _look_for_lines(
    value: float, white: float, turning: float, memory: float, lines: _Lines, phasors: F2
) -> None:
    """Find out whether the readings still have the power of their lines."""
    seen = min(lines.rows, memory)
    period = min(lines.rows, max(memory / _PERIODS, 1.0))
    lines.power += (value * value - lines.power) / period
    if math.isfinite(white):
        lines.white += (white - lines.white) / period
    power = wobble = 0.0
    for k in range(phasors.shape[0]):
        for part in range(2):
            away = phasors[k, part] - phasors[k, part + 2]
            wobble += 0.5 * away * away
            if not lines.gone:
                phasors[k, part + 2] += away / seen
            power += 0.5 * phasors[k, part + 2] * phasors[k, part + 2]
    vanished = lines.power - lines.white < _VANISHED * power
    if not vanished:  # what vanishes moves its phasors, too
        lines.wobble += (wobble - lines.wobble) / seen
    # The motion at the start is in the phasors, too, and has died out of them by then.
    known = lines.rows >= 2.0 * memory and lines.wobble < _WOBBLE * power
    known = known and lines.power < _WHITE * lines.white < _WHITE * _VANISHED * power
    if math.isfinite(turning):
        lines.turning += (turning - lines.turning) / seen
        known = known and abs(turning - lines.turning) < _STEADY * lines.turning
    lines.gone = vanished and (known or lines.gone)
