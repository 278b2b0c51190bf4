"""The second opinion on the amplitude: the Hilbert envelope against the filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.estimation.hilbert import HilbertEnvelope

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
        self._grid = np.linspace(0.0, 0.5 * rate, _FREQUENCIES)
        self._gain = self._envelope.gain(self._grid)
        self._image = self._envelope.gain(-self._grid)
        self.reset()

    def reset(self) -> None:
        """Forget every row."""
        self._envelope.reset()
        self._before = np.full((4, self._late), np.nan)
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
            count = np.maximum(samples[part], 1)
            told = np.stack([amplitude[part], amplitude_std[part], frequency_hz[part], count])
            told = np.concatenate([self._before, told], axis=1)
            then, self._before = told[:, : end - begin], told[:, end - begin :]
            passed, image = self._passed(then[2], then[3])
            expected, tolerance = passed * then[0], passed * then[1]
            noise = self._envelope.noise_gain * noise_std[part] / np.sqrt(count)
            limit = np.maximum(
                _SIGMA * np.hypot(tolerance, noise),
                _SHARE * expected,
            )
            disagree[part] = np.abs(envelope[part] - expected) > limit + image * then[0]
        if rows_ns.size:
            self._next_ns = int(rows_ns[-1]) + self._config.period_ns
        return envelope, disagree

    def _passed(
        self, frequency_hz: NDArray[np.float64], samples: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the gain for a motion, and for its image, of row means and band-pass."""
        # Mean of n samples over a row: sin(x) / (n sin(x / n)), x = pi f T.
        turn = np.pi * frequency_hz / self._rate
        with np.errstate(invalid='ignore', divide='ignore'):
            mean = np.where(turn > 0.0, np.sin(turn) / (samples * np.sin(turn / samples)), 1.0)
        gain = np.interp(frequency_hz, self._grid, self._gain)
        return mean * gain, mean * np.interp(frequency_hz, self._grid, self._image)
