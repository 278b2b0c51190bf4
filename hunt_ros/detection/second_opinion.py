"""
The second opinion on the amplitude: the Hilbert envelope of the readings against the filter.

It takes nothing from the filter but the numbers that it judges: the readings are averaged over the
rows, and known lines are taken out by adaptive noise cancelling (Widrow et al., Proc. IEEE 63,
1975, 1692-1716), a notch whose phasors follow the angle of the roller.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import B1, F1, R1, compiled, compiled_part
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.estimation.hilbert import HilbertEnvelope

_F = NDArray[np.float64]

#: The two estimates disagree beyond this many standard deviations, and beyond this share of the
#: amplitude: what the band-pass leaves of a changing amplitude is less.
_SIGMA, _SHARE = 4.0, 0.15
#: The phasors of the lines, and the noise, are means over so many periods of the hunting.
_PERIODS = 10.0
#: What the hunting left in a phasor at the start is forgotten after so many of these times.
_SETTLED = 3.0
#: A sensor shows nothing any more where its readings have less than this part of the power of
#: their lines, and no more than so many times that of white noise: a line that is cancelled by a
#: motion, or beats with one that is not known, leaves other motion. So long as the lines had this
#: part of the power of all before, and the roller turns as fast as it did to within this part.
_VANISHED, _WHITE, _MADE_UP, _STEADY = 0.25, 2.0, 0.02, 0.1
#: Places in the memory of the kernel: rows that were taken in; mean square of the third
#: difference; the three values before; mean squares over a period of readings, of lines and of the
#: noise; of the readings over the memory; turns per second over it; whether the lines have
#: vanished; then the phasors of the lines, the first of which is the mean.
_ROWS, _NOISE, _BEFORE, _SHOWN, _SAID, _NOISE_NOW = 0, 1, 2, 5, 6, 7
_ALL, _TURNING, _GONE, _LINES = 8, 9, 10, 11
#: Frequencies at which the gain of the envelope is tabulated.
_FREQUENCIES = 400


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
        self._orders = np.array([0.0, *orders])
        self._memory = _PERIODS * self._rate / config.hunting_frequency_hz
        self._grid = np.linspace(0.0, 0.5 * self._rate, _FREQUENCIES)
        self._gains = self._envelope.gain(self._grid), self._envelope.gain(-self._grid)
        self._state = np.zeros(_LINES + 2 * self._orders.size)
        self._state[_LINES] = np.nan
        self._last_ns: int | None = None
        self._start_again()

    def _start_again(self) -> None:
        """Begin anew behind missing rows, from the mean and the lines that there were before."""
        self._envelope.reset()
        # What the envelope is to be compared with, for as many rows as it is late.
        self._said = np.full((4, self._late), np.nan)
        self._state[:_LINES] = 0.0
        self._state[_BEFORE : _BEFORE + 3] = np.nan

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
            Stamps of the rows, m > 0.
        stamps_ns, values : ndarray, shape (n,)
            Readings since the last row before, none after the last row, in the unit of the sensor.
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
        noise = np.empty(size)
        row = np.searchsorted(rows_ns, stamps_ns)  # the first that is not before the reading
        count = np.bincount(row, minlength=size)
        sums = np.bincount(row, values, size)
        means = np.divide(sums, count, out=np.full(size, math.nan), where=count > 0)
        steps = np.diff(rows_ns, prepend=rows_ns[0] if self._last_ns is None else self._last_ns)
        cuts = np.flatnonzero(steps > self._period_ns).tolist()
        for begin, end in zip([0, *cuts], [*cuts, size], strict=True):
            if begin in cuts:
                self._start_again()
            part = slice(begin, end)
            tuned = self._orders, self._memory, self._state
            _take_out(means[part], angle[part], turning[part], *tuned, noise[part], gone[part])
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
        away = np.abs(hz - np.multiply.outer(self._orders[1:], turning))
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
    state: F1,
    noise: F1,
    gone: B1,
) -> None:
    """
    Take mean and lines out of the values of rows, NaN: none; fill in the deviation of their noise.

    White noise of variance s^2 has third differences of 20 s^2, a slow motion has none.
    """
    before = state[_BEFORE : _BEFORE + 3]
    for i in range(values.size):
        value = values[i]
        if math.isfinite(value):
            state[_ROWS] = min(state[_ROWS] + 1.0, _SETTLED * memory)
            seen = min(state[_ROWS], memory)
            third = value - 3.0 * before[0] + 3.0 * before[1] - before[2]
            before[2], before[1], before[0] = before[1], before[0], value
            if math.isnan(state[_LINES]):  # a sensor reads far from 0 at rest
                state[_LINES] = value
            if math.isfinite(third):
                state[_NOISE] += (third * third / 20.0 - state[_NOISE]) / seen
            line = 0.0
            for k in range(1, orders.size):
                if math.isfinite(angle[i]):
                    turn = orders[k] * angle[i]
                    line += state[_LINES + 2 * k] * math.cos(turn)
                    line += state[_LINES + 1 + 2 * k] * math.sin(turn)
            value -= state[_LINES]
            _look_for_lines(value, line, third, turning[i], memory, state)
            value -= line
            # As a mean over what there is at first: over a tenth of the memory at least.
            gain = 2.0 * value / (seen + 0.1 * memory)
            state[_LINES] += 0.5 * gain
            for k in range(1, orders.size):
                if math.isfinite(angle[i]) and state[_GONE] == 0.0:
                    state[_LINES + 2 * k] += gain * math.cos(orders[k] * angle[i])
                    state[_LINES + 1 + 2 * k] += gain * math.sin(orders[k] * angle[i])
            values[i] = value
        noise[i] = math.sqrt(state[_NOISE]) if state[_ROWS] >= _SETTLED * memory else math.nan
        gone[i] = state[_GONE] != 0.0


@compiled_part
def _look_for_lines(
    value: float, line: float, third: float, turning: float, memory: float, state: F1
) -> None:
    """Find out whether the readings still have the power of their lines."""
    seen = min(state[_ROWS], memory)
    period = min(state[_ROWS], max(memory / _PERIODS, 1.0))
    state[_SHOWN] += (value * value - state[_SHOWN]) / period
    state[_SAID] += (line * line - state[_SAID]) / period
    if math.isfinite(third):
        state[_NOISE_NOW] += (third * third / 20.0 - state[_NOISE_NOW]) / period
    state[_ALL] += (value * value - state[_ALL]) / seen
    # The motion at the start is in the phasors, too, and has died out of them by then.
    known = state[_ROWS] >= 2.0 * memory and state[_SAID] > _MADE_UP * state[_ALL]
    known &= state[_SHOWN] < _WHITE * state[_NOISE_NOW]
    if math.isfinite(turning):
        state[_TURNING] += (turning - state[_TURNING]) / seen
        known &= abs(turning - state[_TURNING]) < _STEADY * state[_TURNING]
    known |= state[_GONE] != 0.0
    state[_GONE] = 1.0 if known and state[_SHOWN] < _VANISHED * state[_SAID] else 0.0
