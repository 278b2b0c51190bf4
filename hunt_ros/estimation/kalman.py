"""
The hunting tracker: what the rest of the package calls.

The filter itself, and the model behind it, is in `hunt_ros.estimation.tracker.block`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.errors import HuntError
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.block import track_block
from hunt_ros.estimation.tracker_config import ModePoint, TrackerConfig

__all__ = ['TRACK_DTYPE', 'HuntingTracker', 'ModePoint', 'TrackerConfig']

_NUMBERS = (
    'lateral_amplitude',
    'lateral_amplitude_std',
    'lateral_amplitude_rate',
    'lateral_amplitude_rate_std',
    'yaw_amplitude',
    'yaw_amplitude_std',
    'yaw_amplitude_rate',
    'yaw_amplitude_rate_std',
    'phase',
    'phase_std',
    'frequency_hz',
    'frequency_hz_std',
    'growth_rate',
    'growth_rate_std',
    'lateral_roughness',
    'lateral_roughness_std',
    'lateral_roughness_second',
    'yaw_roughness',
    'yaw_roughness_std',
    'yaw_roughness_second',
    'lateral_bias',
    'yaw_bias',
    'lateral_residual',
    'yaw_residual',
    'lateral_nis',
    'yaw_nis',
    'lateral_clean',
    'yaw_clean',
    'lateral_noise_std',
    'yaw_noise_std',
    'yaw_ratio',
    'yaw_ratio_std',
    'yaw_lag',
    'bandwidth',
    'second_mode_amplitude',
    'since_kick',
    'lateral_tied',
)

#: One estimate. Amplitudes, biases, residuals in the unit of the sensor (m, rad); rates per
#: second; phase and yaw_lag in rad (y = amplitude cos(phase)); bandwidth in 1/s; lateral_tied
#: is 1 where the lateral amplitude is that of yaw through the mode shape, 0 where it is measured.
TRACK_DTYPE: np.dtype[np.void] = np.dtype(
    [('stamp_ns', np.int64), *((name, np.float64) for name in _NUMBERS)]
)

#: Columns that are per second.
_RATES = (
    at.O_Y_RATE,
    at.O_Y_RATE_STD,
    at.O_P_RATE,
    at.O_P_RATE_STD,
    at.O_FREQUENCY,
    at.O_FREQUENCY_STD,
    at.O_GROWTH,
    at.O_GROWTH_STD,
    at.O_BANDWIDTH,
)

_NEVER = np.iinfo(np.int64).min // 2


class HuntingTracker:
    """
    Amplitude, frequency, growth rate of the hunting motion, live.

    An extended Kalman filter over both sensors that splits the signals into the
    hunting phasor, a fast-decaying second mode, the known lines of what turns (the
    roughness of roller and wheel) and a bias, and that finds its own noise levels.

    Parameters
    ----------
    config : TrackerConfig, optional

    Notes
    -----
    Answers to bad input: a value that is not finite, a stamp behind the last one of the
    same or another sensor, a repeated stamp of one sensor, a value that has not changed for
    `stuck_s` and a single outlier are left out of the estimate and counted in `dropped`.
    Feeding the same samples and output stamps in other blocks gives the same numbers,
    bit for bit, as long as each call holds all samples up to its last output stamp.
    """

    def __init__(self, config: TrackerConfig | None = None) -> None:
        self.config = config or TrackerConfig()
        c = self.config
        scale = c.time_scale  # from here on, time in units that make the nominal 2.84 Hz
        turn = 2.0 * math.pi / scale
        nominal = turn * c.frequency_hz
        self._modes = c.mode_table()
        settings = np.zeros(at.N_CONFIG)
        settings[at.C_SECOND] = 1e-9 * scale
        settings[at.C_BIN] = round(c.bin_s * 1e9) * settings[at.C_SECOND]
        settings[at.C_OMEGA_MIN] = turn * c.frequency_min_hz
        settings[at.C_OMEGA_MAX] = turn * c.frequency_max_hz
        settings[at.C_OMEGA_STD] = c.frequency_std * nominal
        settings[at.C_OMEGA_DRIFT] = c.frequency_drift * nominal / math.sqrt(scale)
        settings[at.C_GROWTH_STD] = c.growth_rate_std / scale
        settings[at.C_GROWTH_DRIFT] = c.growth_rate_drift / (scale * math.sqrt(scale))
        settings[at.C_RATIO_STD] = c.yaw_ratio_std
        settings[at.C_RATIO_FLOOR] = c.yaw_ratio_floor
        settings[at.C_GATE] = c.surprise
        settings[at.C_NOISE_TIME] = c.noise_time * scale
        settings[at.C_BANDWIDTH_TIME] = c.bandwidth_time * scale
        settings[at.C_STUCK] = c.stuck_s * scale
        settings[at.C_GAP] = c.gap_s * scale
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget everything seen."""
        memory = np.zeros(at.N_MEMORY)
        memory[[at.M_KICK, at.M_STEP]] = -math.inf
        memory[[at.M_SPEED, at.M_SPEED_SEEN, at.M_ANGLE]] = math.nan
        if math.isnan(self._modes[0, 0, 2]):
            memory[at.M_RATIO_VAR] = 1.0
        else:
            memory[at.M_RATIO_RE] = memory[at.M_RATIO_KNOWN] = 1.0
            memory[at.M_RATIO_VAR] = self.config.yaw_ratio_std**2
        sensors = np.zeros((2, at.N_SENSOR))
        sensors[:, at.S_VALUE] = math.nan
        counters = np.zeros(at.N_COUNTER, dtype=np.int64)
        counters[at.I_LAST : at.I_OUTPUT + 1] = _NEVER
        lines, slips = self.config.line_table()
        size = at.ROUGH + 4 * lines.shape[0] + slips.size
        P = np.zeros((size, size))
        own = np.arange(size - slips.size, size)
        P[own, own] = slips**2
        self._filter = at.Filter(
            x=np.zeros(size),
            P=P,
            m=memory,
            sensors=sensors,
            sums=np.zeros((2, at.A_LINES + 2 * lines.shape[0])),
            counters=counters,
            cfg=self._settings,
            modes=self._modes,
            lines=lines,
            rough=np.zeros((2, lines.shape[0], at.N_LINE)),
            slips=np.stack([slips, np.zeros_like(slips)], axis=1),
            g=np.zeros(size),
        )

    def update(
        self,
        stamps_ns: ArrayLike,
        sensor: ArrayLike,
        values: ArrayLike,
        roller_angle: ArrayLike,
        speed: ArrayLike,
        output_ns: ArrayLike,
    ) -> NDArray[np.void]:
        """
        Take a block of samples, and give the estimates at the stamps asked for.

        Parameters
        ----------
        stamps_ns : array_like of int64, shape (n,)
            Stamps of the samples of both sensors, sorted.
        sensor : array_like of int8, shape (n,)
            0 lateral, 1 yaw.
        values : array_like, shape (n,)
            m or rad, or any unit that stays the same.
        roller_angle : array_like, shape (n,)
            Continuous angle at each sample that the lines of `TrackerConfig.shafts` turn with,
            rad; NaN: not known, no line is told apart.
        speed : array_like, shape (n,)
            Running speed at each sample, m/s; NaN: as before.
        output_ns : array_like of int64, shape (m,)
            Stamps at which estimates are wanted, increasing, also from call to call.

        Returns
        -------
        ndarray of TRACK_DTYPE, shape (m,)
            Row k is the estimate at output_ns[k] from all samples up to that stamp;
            NaN where nothing is known.

        Raises
        ------
        HuntError
            If the arrays differ in length, a sensor is neither 0 nor 1, or output stamps
            do not increase; nothing has been taken in then.
        """
        stamps = np.ascontiguousarray(stamps_ns, dtype=np.int64)
        sensors = np.ascontiguousarray(sensor, dtype=np.int8)
        measured = np.ascontiguousarray(values, dtype=np.float64)
        angles = np.ascontiguousarray(roller_angle, dtype=np.float64)
        speeds = np.ascontiguousarray(speed, dtype=np.float64)
        outputs = np.ascontiguousarray(output_ns, dtype=np.int64)
        shape = stamps.shape
        if len(shape) != 1 or any(a.shape != shape for a in (sensors, measured, angles, speeds)):
            raise HuntError(
                f'tracker: {shape} stamps, {sensors.shape} sensors, {measured.shape} values,'
                f' {angles.shape} angles and {speeds.shape} speeds, expected one of each a sample'
            )
        if shape[0] and (sensors.min() < 0 or sensors.max() > 1):
            raise HuntError('tracker: a sensor number must be 0 (lateral) or 1 (yaw)')
        if outputs.size and (
            outputs[0] <= self._filter.counters[at.I_OUTPUT]
            or (outputs.size > 1 and bool(np.any(outputs[1:] <= outputs[:-1])))
        ):
            raise HuntError(f'tracker: output stamps must increase, got {outputs[0]} first')
        rows = np.full((outputs.size, at.N_OUTPUT), math.nan)
        self._run(stamps, sensors, measured, angles, speeds, outputs, rows)
        rows[:, _RATES] *= self.config.time_scale
        rows[:, at.O_SINCE_KICK] /= self.config.time_scale
        track = np.empty(outputs.size, dtype=TRACK_DTYPE)
        track['stamp_ns'] = outputs
        track.view(np.float64).reshape(outputs.size, len(_NUMBERS) + 1)[:, 1:] = rows
        return track

    def _run(
        self,
        stamps: NDArray[np.int64],
        sensors: NDArray[np.int8],
        values: NDArray[np.float64],
        angles: NDArray[np.float64],
        speeds: NDArray[np.float64],
        outputs: NDArray[np.int64],
        rows: NDArray[np.float64],
    ) -> None:
        track_block(self._filter, stamps, sensors, values, angles, speeds, outputs, rows)

    def set_modes(self, modes: Sequence[ModePoint], yaw_ratio_std: float | None = None) -> None:
        """
        Use another table of modes from the next sample on; what was learnt is kept.

        Parameters
        ----------
        modes : sequence of ModePoint
            As in `TrackerConfig.modes`; empty: the constants of the settings.
        yaw_ratio_std : float, optional
            As in `TrackerConfig`; None: as before.

        Raises
        ------
        ConfigError
            For a table `TrackerConfig` would not take.
        """
        self.config = replace(
            self.config,
            modes=tuple(modes),
            yaw_ratio_std=self.config.yaw_ratio_std if yaw_ratio_std is None else yaw_ratio_std,
        )
        self._modes = self.config.mode_table()
        self._settings[at.C_RATIO_STD] = self.config.yaw_ratio_std
        self._filter = self._filter._replace(modes=self._modes)
        self._filter.m[at.M_CHANGED] = 1.0

    @property
    def state(self) -> NDArray[np.float64]:
        """Copy of the state vector, shape (n,), in the order of `tracker.layout`, in its time."""
        state: NDArray[np.float64] = self._filter.x.copy()
        return state

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Copy of the covariance of `state`, shape (n, n)."""
        covariance: NDArray[np.float64] = self._filter.P.copy()
        return covariance

    @property
    def kicks(self) -> int:
        """Kicks seen since the start."""
        return int(self._filter.counters[at.I_KICKS])

    @property
    def restarts(self) -> int:
        """Sensors started anew because their signal was no more the one they had given."""
        return int(self._filter.counters[at.I_RESTARTS])

    @property
    def dropped(self) -> dict[str, int]:
        """Samples left out since the start, by reason."""
        return {
            'not_finite': int(self._filter.counters[at.I_NOT_FINITE]),
            'backwards': int(self._filter.counters[at.I_BACKWARDS]),
            'stuck': int(self._filter.counters[at.I_STUCK]),
            'glitches': int(self._filter.counters[at.I_GLITCHES]),
        }
