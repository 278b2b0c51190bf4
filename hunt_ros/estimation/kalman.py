"""
The hunting tracker: what the rest of the package calls.

The filter itself, and the model behind it, is in `hunt_ros.estimation.tracker.block`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.compiled import runs_compiled
from hunt_ros.errors import HuntError
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.block import ESTIMATE, track_block
from hunt_ros.estimation.tracker_config import TrackerConfig
from hunt_ros.records import zeros
from hunt_ros.sensors import COORDINATES, MOTION

__all__ = ['TRACK_DTYPE', 'HuntingTracker', 'TrackerConfig']

#: Parts of a row of the kernel: whose they are, and what they hold.
_PARTS = {'coordinates': (COORDINATES, at.Motion), 'sensors': (MOTION, at.Reading)}


def _columns() -> Iterator[str]:
    """Yield the names of the numbers of a row, in the order of the kernel's memory."""
    for name in at.Estimate.__annotations__:
        if name in _PARTS:
            owners, part = _PARTS[name]
            yield from (f'{one}_{what}' for one in owners for what in part.__annotations__)
        else:
            yield name


#: One estimate, with the columns of `layout.Estimate`. Amplitudes in the unit of the coordinate
#: (m, rad), what a sensor shows in its own; NaN: not known. A coordinate is NaN where only the
#: other one is told and no ratio ties the two.
TRACK_DTYPE: np.dtype[np.void] = np.dtype(
    [(name, np.int64 if name == 'stamp_ns' else np.float64) for name in _columns()]
)

#: A sensor whose value does not change for this long is not measuring.
STUCK_S = 0.05

_NEVER = np.iinfo(np.int64).min // 2
#: Relative standard deviation of a ratio that is given by who knows no better.
_RATIO_STD = 0.1
#: Types of the columns of a sample.
_SAMPLE = (np.int64, np.int8, np.float64, np.float64, np.float64)


class HuntingTracker:
    """
    Amplitude, frequency, growth rate of the hunting motion, live.

    An extended Kalman filter over all sensors of the motion that splits the signals into the
    hunting phasor, a fast-decaying second mode, the known lines of what turns (the
    roughness of roller and wheel) and a bias, and that finds its own noise levels.

    Parameters
    ----------
    config : TrackerConfig, optional

    Notes
    -----
    Left out of the estimate are a value that is not finite, a stamp behind the last one of the
    same or another sensor, a repeated stamp of one sensor, a value that has not changed for
    `STUCK_S`, and samples that are wrong, also in a row.
    Feeding the same samples and output stamps in other blocks gives the same numbers,
    bit for bit, as long as each call holds all samples up to its last output stamp.
    """

    def __init__(self, config: TrackerConfig | None = None) -> None:
        self.config = config or TrackerConfig()
        turn = 2.0 * math.pi / self.config.time_scale
        #: Of the mode, shape (speeds, amplitudes, 6): speed; hunting frequency, in rad per unit of
        #: the tracker's time; ratio, real and imaginary (NaN: unknown); amplitude; relative
        #: standard deviation of the ratio.
        self._modes = self._no_modes = np.array(
            [[[0.0, turn * self.config.frequency_hz, math.nan, math.nan, 0.0, 0.0]]]
        )
        self._ratio_std = _RATIO_STD
        self.reset()

    def reset(self) -> None:
        """Forget everything seen."""
        t = self._tracker = zeros(at.Tracker, runs_compiled())
        t.turns_angle = math.nan
        t.last_stamp = t.last_output = _NEVER
        for read in t.inputs:
            read.value, read.last_stamp = math.nan, _NEVER
        f = t.filters[0]
        f.alive = True
        self._set_up(f.cfg)
        f.kick = f.opened = -math.inf
        f.speed = f.speed_seen = f.angle = math.nan
        if math.isnan(self._modes[0, 0, 2]):
            f.ratio_var = 1.0
        else:
            f.ratio, f.ratio_known = 1.0 + 0j, True
            f.ratio_var = self._ratio_std**2
        for shaft in self.config.shafts:
            slip = -1
            if shaft.slip_std > 0.0 and shaft.orders:
                slip, f.slip_count = f.slip_count, f.slip_count + 1
                f.slips[slip].deviation = shaft.slip_std
            for order in shaft.orders:
                line, f.line_count = f.lines[f.line_count], f.line_count + 1
                line.order, line.slip = order, slip
        self._set_up_sensors(f)
        for j in range(f.slip_count):
            own = f.states - f.slip_count + j
            f.P[own, own] = f.slips[j].deviation ** 2

    def _set_up_sensors(self, f: at.Filter) -> None:
        """Lay out the state: what each sensor has in it, and the slips behind."""
        sensors, scale = self.config.sensors, self.config.time_scale
        f.sensor_count = len(sensors)
        place = at.BIAS + len(sensors) * (1 + 2 * f.line_count)
        measured: set[str] = set()
        for own, sensor in zip(f.sensors, sensors, strict=False):
            own.stepped, own.strange_since = -math.inf, math.inf
            own.coordinate = COORDINATES.index(sensor.coordinate)
            own.column = MOTION.index(sensor.name)
            own.derivative, own.unit = sensor.derivative, scale**sensor.derivative
            own.scale = -1  # the first one of a coordinate says how large its motion is
            if sensor.coordinate in measured:
                own.scale, place = place, place + 2
            measured.add(sensor.coordinate)
        f.states = place + f.slip_count

    def _set_up(self, cfg: at.Settings) -> None:
        """Write the settings, in units of time that make the nominal frequency 2.84 Hz."""
        c, scale = self.config, self.config.time_scale
        turn = 2.0 * math.pi / scale
        cfg.second, cfg.scale = 1e-9 * scale, scale
        cfg.bin = round(c.bin_s / scale * 1e9) * cfg.second
        cfg.omega_min, cfg.omega_max = turn * c.frequency_min_hz, turn * c.frequency_max_hz
        cfg.ratio_std = self._ratio_std
        # What repeats a value is a sensor, whose rate does not rise with the frequency.
        cfg.stuck = STUCK_S * max(scale, 1.0)

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
            Stamps of the samples of all sensors, sorted.
        sensor : array_like of int8, shape (n,)
            Place of each one's sensor in `TrackerConfig.sensors`: 0 lateral, 1 yaw by default.
        values : array_like, shape (n,)
            SI, or any unit that stays the same.
        roller_angle : array_like, shape (n,) or ()
            Continuous angle at each sample that the lines of `TrackerConfig.shafts` turn with,
            rad; NaN: not known, no line is told apart.
        speed : array_like, shape (n,) or ()
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
            If there is no such sensor, or output stamps do not increase; nothing has been taken
            in then.
        """
        columns = stamps_ns, sensor, values, roller_angle, speed
        block: list[Any] = [
            np.ascontiguousarray(column, dtype)
            for column, dtype in zip(np.broadcast_arrays(*columns), _SAMPLE, strict=True)
        ]
        outputs = np.ascontiguousarray(output_ns, dtype=np.int64)
        count = len(self.config.sensors)
        if block[0].ndim != 1 or np.any((block[1] < 0) | (block[1] >= count)):
            raise HuntError(f'tracker: expected rows of samples, of sensors 0 to {count - 1}')
        if outputs.size and (
            outputs[0] <= self._tracker.last_output
            or (outputs.size > 1 and bool(np.any(outputs[1:] <= outputs[:-1])))
        ):
            raise HuntError(f'tracker: output stamps must increase, got {outputs[0]} first')
        numbers = np.full(outputs.size * (TRACK_DTYPE.itemsize // 8), math.nan)
        track = numbers.view(TRACK_DTYPE)
        track['stamp_ns'] = outputs
        block += [outputs, track.view(ESTIMATE)]
        track_block(self._tracker, self._modes, *block)
        return track

    def set_modes(self, shape: Any = None, ratio_std: float = _RATIO_STD) -> None:
        """
        Use another mode from the next sample on; what was learnt is kept.

        Parameters
        ----------
        shape : ModeShape, optional
            Interpolated over speed and amplitude, held at its ends; its ratio in the units of the
            two sensors. None: the nominal frequency, no ratio.
        ratio_std : float
            Prior relative standard deviation of a ratio that is given, beside its own: that of the
            scale of the sensors, which is common to the whole table.
        """
        self._modes, self._ratio_std = self._no_modes, ratio_std
        if shape is not None:
            turn = 2.0 * math.pi / self.config.time_scale
            by_speed = shape.speeds[:, None], turn * shape.frequency_hz[:, None]
            ratio = shape.ratio.real, shape.ratio.imag
            columns = np.broadcast_arrays(*by_speed, *ratio, shape.amplitudes, shape.ratio_std)
            self._modes = np.stack(columns, axis=2)
        for f in self._tracker.filters:
            f.cfg.ratio_std = ratio_std
            f.modes_changed = True
