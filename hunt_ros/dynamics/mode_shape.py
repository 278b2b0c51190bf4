"""
The hunting mode as the two sensors see it: yaw over lateral, by speed and amplitude.

It is measured by `hunt_ros.estimation.mode_measurement` or follows from the
equations of motion, stands in the parameter file beside the normal form, and lets the
tracker tell the lateral amplitude from the yaw sensor alone.
"""

from __future__ import annotations

import sys
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
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
        shapes = {'amplitudes': (m,), 'ratio': (n, m), 'ratio_std': (n, m)}
        positive = ('frequency_hz', 'second_frequency_hz', 'second_decay')
        known = self.second_frequency_hz is not None and self.second_decay is not None
        for name in (one.name for one in fields(self)):
            table, shape = getattr(self, name), shapes.get(name, (n,))
            if table is None:
                continue
            problem = ''
            if table.shape != shape or not n or not m:
                problem = f'is {table.shape}, expected {shape}'
            elif not np.isfinite(table).all():
                problem = 'must be finite numbers'
            elif name.startswith('second') and not known:
                problem = 'needs frequency and decay of the second mode'
            elif np.iscomplexobj(table):
                pass
            elif name in ('speeds', 'amplitudes') and np.any(np.diff(table) <= 0.0):
                problem = 'must increase'
            elif name in positive and np.any(table <= 0.0):
                problem = f'must be positive, got {table.min():g}'
            elif name != 'speeds' and np.any(table < 0.0):
                problem = f'must not be negative, got {table.min():g}'
            elif name == 'second_std' and np.any(table >= 1.0):
                problem = f'must be below 1, got {table.max():g}'
            if problem:
                raise ConfigError(f'mode shape: {name} {problem}')

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
        lists = {name: numbers(group.get(name), name, source) for name in KEYS}
        speed, amplitude, frequency, real, imag, std, *second = lists.values()
        if not real.size:
            return None
        for name in KEYS[:6]:
            if not lists[name].size:
                raise ConfigError(f'{source}: {name} is missing beside mode_ratio_real')
        # Frequency, decay, ratio and deviation of the second mode, each of which may be missing.
        hz, decay, second_real, second_imag, doubt = second
        both = second_real.size and second_imag.size
        try:
            return cls(
                speed,
                amplitude,
                frequency,
                (real + 1j * imag).reshape(speed.size, -1),
                std.reshape(speed.size, -1),
                hz if hz.size else None,
                decay if decay.size else None,
                second_real + 1j * second_imag if both else None,
                doubt if doubt.size else None,
            )
        except ConfigError as error:
            raise ConfigError(f'{source}: {error}') from error
        except ValueError as error:
            raise ConfigError(f'{source}: lists of the mode shape differ in length') from error


def _between(x: float, nodes: _F, values: NDArray[np.complex128]) -> complex:
    return complex(np.interp(x, nodes, values.real) + 1j * np.interp(x, nodes, values.imag))


def numbers(values: object, name: str, source: str, expected: str = 'a list of numbers') -> _F:
    """
    Return a list of a parameter file as an array, shape (n,); empty where there is none.

    Parameters
    ----------
    values : object
        A list from YAML, an `array.array` from rclpy, one number, or None.
    name, source, expected : str
        Key, file and what should stand there, for the message.

    Raises
    ------
    ConfigError
        For anything else, and numbers that are not finite.
    """
    if values is None:
        return np.zeros(0)
    listed = isinstance(values, Sequence | array) and not isinstance(values, str | bytes)
    entries: list[Any] = list(values) if listed else [values]  # type: ignore[call-overload]
    for entry in entries:
        if isinstance(entry, bool) or not isinstance(entry, int | float):
            raise ConfigError(f'{source}: {name} must be {expected}, got {str(entry)[:40]!r}')
        # A whole number may be larger than any float.
        if not -sys.float_info.max <= entry <= sys.float_info.max:
            raise ConfigError(f'{source}: {name} must be a finite number, got {entry!s:.40}')
    return np.array(entries, dtype=np.float64)
