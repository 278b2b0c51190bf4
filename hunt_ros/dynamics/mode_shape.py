"""
The hunting mode as the two sensors see it: yaw over lateral, by speed and amplitude.

It is measured by `hunt_ros.estimation.mode_measurement` or follows from the
equations of motion, stands in the parameter file beside the normal form, and lets the
tracker tell the lateral amplitude from the yaw sensor alone.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.errors import ConfigError

_F = NDArray[np.float64]

#: Keys in a parameter file: all lists of numbers. The ratio is in rad/m.
KEYS = (
    'mode_speed',
    'mode_amplitude',
    'mode_frequency_hz',
    'mode_ratio_real',
    'mode_ratio_imag',
    'mode_ratio_std',
    'second_mode_frequency_hz',
    'second_mode_decay',
    'second_mode_ratio_real',
    'second_mode_ratio_imag',
    'second_mode_std',
)


@dataclass(frozen=True, eq=False)
class ModeShape:
    """
    Tables over running speed and lateral amplitude, to be interpolated and held at their ends.

    Parameters
    ----------
    speeds : ndarray, shape (n,)
        m/s, increasing.
    amplitudes : ndarray, shape (m,)
        Amplitude of the lateral motion, m, increasing.
    frequency_hz : ndarray, shape (n,)
        Of the hunting mode, Hz.
    ratio : ndarray of complex, shape (n, m)
        Yaw phasor over lateral phasor, rad/m.
    ratio_std : ndarray, shape (n, m)
        Its relative standard deviation.
    second_frequency_hz, second_decay : ndarray, shape (n,), optional
        Frequency (Hz) and decay rate (1/s, positive) of the second mode; None: unknown.
    second_ratio : ndarray of complex, shape (n,), optional
        Its yaw over its lateral phasor, rad/m.
    second_std : ndarray, shape (n,), optional
        Standard deviation of its eigenvalue over the modulus, below 1; None: it is exact.

    Raises
    ------
    ConfigError
        For tables that do not fit together or hold impossible values.
    """

    speeds: _F
    amplitudes: _F
    frequency_hz: _F
    ratio: NDArray[np.complex128]
    ratio_std: _F
    second_frequency_hz: _F | None = None
    second_decay: _F | None = None
    second_ratio: NDArray[np.complex128] | None = None
    second_std: _F | None = None

    def __post_init__(self) -> None:
        n, m = self.speeds.size, self.amplitudes.size
        for name, shape in (
            ('speeds', (n,)),
            ('amplitudes', (m,)),
            ('frequency_hz', (n,)),
            ('ratio', (n, m)),
            ('ratio_std', (n, m)),
            ('second_frequency_hz', (n,)),
            ('second_decay', (n,)),
            ('second_ratio', (n,)),
            ('second_std', (n,)),
        ):
            table = getattr(self, name)
            if table is None:
                continue
            if table.shape != shape or not n or not m:
                raise ConfigError(f'mode shape: {name} is {table.shape}, expected {shape}')
            if not np.isfinite(table).all():
                raise ConfigError(f'mode shape: {name} must be finite numbers')
            if name not in ('ratio', 'second_ratio', 'speeds') and np.any(table < 0.0):
                raise ConfigError(f'mode shape: {name} must not be negative, got {table.min():g}')
        for name in ('speeds', 'amplitudes'):
            if np.any(np.diff(getattr(self, name)) <= 0.0):
                raise ConfigError(f'mode shape: {name} must increase')
        for name in ('frequency_hz', 'second_frequency_hz', 'second_decay'):
            table = getattr(self, name)
            if table is not None and np.any(table == 0.0):
                raise ConfigError(f'mode shape: {name} must be positive')
        if (self.second_frequency_hz is None) != (self.second_decay is None):
            raise ConfigError('mode shape: the second mode needs frequency and decay')
        for name in ('second_ratio', 'second_std'):
            if getattr(self, name) is not None and self.second_decay is None:
                raise ConfigError(f'mode shape: {name} needs the second mode')
        if self.second_std is not None and np.any(self.second_std >= 1.0):
            raise ConfigError('mode shape: second_std must be below 1')

    def at(self, speed: float, amplitude: float) -> complex:
        """Yaw over lateral phasor, rad/m, at a speed (m/s) and lateral amplitude (m)."""
        along = [complex(_between(amplitude, self.amplitudes, row)) for row in self.ratio]
        return complex(_between(speed, self.speeds, np.array(along)))

    def to_parameters(self) -> dict[str, list[float]]:
        """Return the entries of the parameter file, `KEYS`: flat lists, speed by speed."""
        tables = {
            'mode_speed': self.speeds,
            'mode_amplitude': self.amplitudes,
            'mode_frequency_hz': self.frequency_hz,
            'mode_ratio_real': self.ratio.real,
            'mode_ratio_imag': self.ratio.imag,
            'mode_ratio_std': self.ratio_std,
            'second_mode_frequency_hz': self.second_frequency_hz,
            'second_mode_decay': self.second_decay,
            'second_mode_std': self.second_std,
        }
        if self.second_ratio is not None:
            tables['second_mode_ratio_real'] = self.second_ratio.real
            tables['second_mode_ratio_imag'] = self.second_ratio.imag
        return {
            name: [float(value) for value in table.ravel()]
            for name, table in tables.items()
            if table is not None
        }

    @classmethod
    def from_parameters(cls, group: Mapping[str, Any], source: str) -> ModeShape | None:
        """
        Read the entries of a parameter file.

        Parameters
        ----------
        group : mapping
            May hold any other keys.
        source : str
            Named in messages.

        Returns
        -------
        ModeShape or None
            None where the file holds no ratio.

        Raises
        ------
        ConfigError
            Naming the key that is missing or impossible.
        """
        lists = {name: _numbers(group.get(name), name, source) for name in KEYS}
        if lists['mode_ratio_real'] is None:
            return None
        for name in KEYS[:6]:
            if lists[name] is None:
                raise ConfigError(f'{source}: {name} is missing beside mode_ratio_real')
        first, _, _, real, imag, std = (_known(lists[name]) for name in KEYS[:6])
        second = lists['second_mode_ratio_real'], lists['second_mode_ratio_imag']
        try:
            return cls(
                first,
                _known(lists['mode_amplitude']),
                _known(lists['mode_frequency_hz']),
                (real + 1j * imag).reshape(first.size, -1),
                std.reshape(first.size, -1),
                lists['second_mode_frequency_hz'],
                lists['second_mode_decay'],
                None if second[0] is None or second[1] is None else second[0] + 1j * second[1],
                lists['second_mode_std'],
            )
        except ConfigError as error:
            raise ConfigError(f'{source}: {error}') from error
        except ValueError as error:
            raise ConfigError(f'{source}: lists of the mode shape differ in length') from error


def _between(x: float, nodes: _F, values: NDArray[np.complex128]) -> complex:
    return complex(np.interp(x, nodes, values.real) + 1j * np.interp(x, nodes, values.imag))


def _known(table: _F | None) -> _F:
    assert table is not None
    return table


def _numbers(value: object, name: str, source: str) -> _F | None:
    """Return a list of the file as an array; None where there is none, or an empty one."""
    if value is None:
        return None
    # A list from YAML, an array.array from rclpy: any sequence of numbers will do.
    entries = list(value) if isinstance(value, Sequence | array) else [value]
    if isinstance(value, str | bytes) or any(
        isinstance(entry, bool) or not isinstance(entry, int | float) for entry in entries
    ):
        raise ConfigError(f'{source}: {name} must be a list of numbers, got {str(value)[:40]!r}')
    return np.array(entries, dtype=np.float64) if entries else None
