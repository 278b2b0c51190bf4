"""The second opinion on the amplitude: the Hilbert envelope against the filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.estimation.hilbert import HilbertEnvelope


class SecondOpinion:
    """
    Envelope of one sensor's roughness-free signal, compared with the filter's amplitude.

    The envelope is half a filter length late, so it is compared with what the filter
    said then.

    Parameters
    ----------
    config : DetectorConfig
        Band, rate and limits of the disagreement.
    """

    def __init__(self, config: DetectorConfig) -> None:
        rate = 1e9 / config.period_ns
        # An octave below the nominal frequency; lower would make the filter longer and later.
        low = max(config.hunting_frequency_min_hz, 0.5 * config.hunting_frequency_hz)
        high = min(config.hunting_frequency_max_hz, 0.45 * rate)
        self._envelope = HilbertEnvelope(rate, low, high, max(0.8, 1.05 / low))
        self._config = config
        self._late = round(self._envelope.delay_s * rate)
        self.reset()

    def reset(self) -> None:
        """Forget every row."""
        self._envelope.reset()
        self._amplitude = np.full(self._late, np.nan)
        self._spread = np.full(self._late, np.nan)
        self._next_ns: int | None = None

    @property
    def delay_s(self) -> float:
        """How late the envelope is, s."""
        return self._envelope.delay_s

    def update(
        self,
        rows_ns: NDArray[np.int64],
        clean: NDArray[np.float64],
        noise_std: NDArray[np.float64],
        amplitude: NDArray[np.float64],
        amplitude_std: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """
        Take rows of the filter.

        Parameters
        ----------
        rows_ns : ndarray of int64, shape (m,)
            Stamps of the rows.
        clean, noise_std, amplitude, amplitude_std : ndarray, shape (m,)
            Roughness-free signal, standard deviation of a sample, amplitude and its
            standard deviation, all in the unit of the sensor.

        Returns
        -------
        envelope : ndarray, shape (m,)
            Envelope `delay_s` before each row; NaN where unknown.
        disagree : ndarray of bool, shape (m,)
            True where the two differ by more than their uncertainty allows.
        """
        envelope = np.empty(rows_ns.size)
        disagree = np.zeros(rows_ns.size, dtype=np.bool_)
        expected = np.empty(rows_ns.size, dtype=np.int64)
        expected[1:] = rows_ns[:-1] + self._config.period_ns
        if rows_ns.size:
            expected[0] = rows_ns[0] if self._next_ns is None else self._next_ns
        cuts = np.flatnonzero(rows_ns != expected).tolist()
        for begin, end in zip([0, *cuts], [*cuts, rows_ns.size], strict=True):
            if begin in cuts:
                self.reset()
            part = slice(begin, end)
            envelope[part] = self._envelope.update(clean[part])
            then = np.concatenate([self._amplitude, amplitude[part]])
            spread = np.concatenate([self._spread, amplitude_std[part]])
            now, tolerance = then[: end - begin], spread[: end - begin]
            self._amplitude, self._spread = then[end - begin :], spread[end - begin :]
            uncertain = np.hypot(tolerance, self._envelope.noise_gain * noise_std[part])
            limit = np.maximum(
                self._config.agreement_sigma * uncertain, self._config.agreement_fraction * now
            )
            disagree[part] = np.abs(envelope[part] - now) > limit
        if rows_ns.size:
            self._next_ns = int(rows_ns[-1]) + self._config.period_ns
        return envelope, disagree
