"""The second opinion on the amplitude: the Hilbert envelope against the filter."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import compiled, compiled_part
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.estimation.hilbert import HilbertEnvelope

_F = NDArray[np.float64]

#: The two estimates disagree beyond this many standard deviations, and beyond this share of the
#: amplitude: what the band-pass leaves of a changing amplitude is less.
_SIGMA, _SHARE = 4.0, 0.15
#: Frequencies at which the gain of the envelope is tabulated.
_FREQUENCIES = 400


class SecondOpinion:
    """
    Envelope of one sensor's roughness-free signal, compared with the filter's amplitude.

    The envelope is half a filter length late, so it is compared with what the filter said
    then: with that amplitude as the row means and the band-pass pass it on at that frequency,
    give or take what they let through of its image at the negative frequency.

    Parameters
    ----------
    config : DetectorConfig
        Band and rate.
    """

    def __init__(self, config: DetectorConfig) -> None:
        rate = 1e9 / config.period_ns
        # An octave below the nominal frequency; lower would make the filter longer and later.
        low = max(config.hunting_frequency_min_hz, 0.5 * config.hunting_frequency_hz)
        high = min(config.hunting_frequency_max_hz, 0.45 * rate)
        self._envelope = HilbertEnvelope(rate, low, high, max(0.8, 1.05 / low))
        self._config = config
        self._late = round(self._envelope.delay_s * rate)
        self._rate = rate
        grid = np.linspace(0.0, 0.5 * rate, _FREQUENCIES)
        self._gains = np.stack([self._envelope.gain(grid), self._envelope.gain(-grid)])
        self._noise_gain = self._envelope.noise_gain
        self.reset()

    def reset(self) -> None:
        """Forget every row."""
        self._envelope.reset()
        # What the filter said in the rows that the envelope is late, in a ring: amplitude,
        # its deviation, frequency, samples of the row.
        self._said = np.full((self._late, 4), np.nan)
        self._place = np.zeros(1, dtype=np.int64)
        self._next_ns: int | None = None

    @property
    def delay_s(self) -> float:
        """How late the envelope is, s."""
        return self._envelope.delay_s

    def update(
        self,
        rows_ns: NDArray[np.int64],
        clean: NDArray[np.float64],
        samples: NDArray[np.int64],
        noise_std: NDArray[np.float64],
        amplitude: NDArray[np.float64],
        amplitude_std: NDArray[np.float64],
        frequency_hz: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """
        Take rows of the filter.

        Parameters
        ----------
        rows_ns : ndarray of int64, shape (m,)
            Stamps of the rows.
        clean : ndarray, shape (m,)
            Roughness-free signal, mean over the samples of each row, unit of the sensor.
        samples : ndarray of int64, shape (m,)
            How many these are.
        noise_std, amplitude, amplitude_std : ndarray, shape (m,)
            Standard deviation of the noise of one sample, amplitude and its standard
            deviation, unit of the sensor.
        frequency_hz : ndarray, shape (m,)
            Of the motion, Hz.

        Returns
        -------
        envelope : ndarray, shape (m,)
            Envelope `delay_s` before each row; NaN where unknown.
        disagree : ndarray of bool, shape (m,)
            True where the two differ by more than their uncertainty allows.
        """
        envelope = np.empty(rows_ns.size)
        disagree = np.zeros(rows_ns.size, dtype=np.bool_)
        follows = np.empty(rows_ns.size, dtype=np.int64)
        follows[1:] = rows_ns[:-1] + self._config.period_ns
        if rows_ns.size:
            follows[0] = rows_ns[0] if self._next_ns is None else self._next_ns
        cuts = np.flatnonzero(rows_ns != follows).tolist()
        for begin, end in zip([0, *cuts], [*cuts, rows_ns.size], strict=True):
            if begin in cuts:
                self.reset()
            part = slice(begin, end)
            envelope[part] = self._envelope.update(clean[part])
            _compare(
                envelope[part],
                np.ascontiguousarray(amplitude[part]),
                np.ascontiguousarray(amplitude_std[part]),
                np.ascontiguousarray(frequency_hz[part]),
                np.ascontiguousarray(noise_std[part]),
                np.ascontiguousarray(samples[part]),
                self._said,
                self._place,
                self._gains,
                self._noise_gain,
                self._rate,
                disagree[part],
            )
        if rows_ns.size:
            self._next_ns = int(rows_ns[-1]) + self._config.period_ns
        return envelope, disagree


@compiled
def _compare(
    envelope: _F,
    amplitude: _F,
    amplitude_std: _F,
    frequency_hz: _F,
    noise_std: _F,
    samples: NDArray[np.int64],
    said: _F,
    place: NDArray[np.int64],
    gains: _F,
    noise_gain: float,
    rate_hz: float,
    disagree: NDArray[np.bool_],
) -> None:
    """Compare the envelope of each row with what the filter said then."""
    for i in range(envelope.size):
        then, deviation, frequency, count = (
            said[place[0], 0],
            said[place[0], 1],
            said[place[0], 2],
            said[place[0], 3],
        )
        now = max(samples[i], 1)
        said[place[0], 0] = amplitude[i]
        said[place[0], 1] = amplitude_std[i]
        said[place[0], 2] = frequency_hz[i]
        said[place[0], 3] = now
        place[0] = (place[0] + 1) % said.shape[0]
        # Mean of n samples over a row: sin(x) / (n sin(x / n)), x = pi f T.
        turn = math.pi * frequency / rate_hz
        mean = math.sin(turn) / (count * math.sin(turn / count)) if turn > 0.0 else 1.0
        passed = mean * _gain_at(gains[0], frequency, rate_hz)
        image = mean * _gain_at(gains[1], frequency, rate_hz)
        noise = noise_gain * noise_std[i] / math.sqrt(now)
        spread = _SIGMA * math.hypot(passed * deviation, noise)
        away = abs(envelope[i] - passed * then) - image * then
        # NaN: one of the two says nothing.
        disagree[i] = away > spread and away > _SHARE * passed * then


@compiled_part
def _gain_at(gains: _F, frequency_hz: float, rate_hz: float) -> float:
    """Interpolate a gain tabulated from 0 to half the rate; NaN where the frequency is."""
    if math.isnan(frequency_hz):
        return math.nan
    place = max(2.0 * frequency_hz / rate_hz, 0.0) * (gains.size - 1)
    low = min(int(place), gains.size - 2)
    return float(gains[low] + min(place - low, 1.0) * (gains[low + 1] - gains[low]))
