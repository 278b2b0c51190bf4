"""
The roller's angle in a whole record: its encoder's, or tracked along an integrated speed.

The one place where identification makes an angle. Everything behind it reads the channel
`roller`, which is continuous, wherever it comes from; `channels` turns it forward.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d

from hunt_ros.estimation.turning import SPEED_STD, continuous
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import Record, Series

_F = NDArray[np.float64]

#: Cells in which the motion is averaged, and length of the windows of which there is one a
#: second: the hunting, a hertz and more away from a line, is not seen in them.
_CELL_S, _WINDOW_S = 0.02, 2.0
#: What the scale of a speed and a diameter may be off by, by three deviations.
_MOST = 3.0 * SPEED_STD
#: Time over which the scale of the speed is taken to be one, s (standard deviation of the weight).
_STEADY_S = 8.0
#: An angle that stays within this begins anew with each turn, rad; more than this from reading to
#: reading is not told from less the other way.
_WITHIN, _HALF = 2.5 * np.pi, 0.9 * np.pi
#: Ratios of turning and speed that are tried: rollers of 0.05 to 3 m, 1/m.
_RATIOS = (2.0 / 3.0, 2.0 / 0.05, 400)


def with_angle(record: Record, settings: IdentificationSettings) -> Record:
    """
    Give a record a continuous angle of the roller.

    With an encoder it is the encoder's, without its wrapping and its steps; without one it is
    integrated from the speed, by the diameter of the roller, and follows the phase of the known
    lines in the lateral channel, since a tachometer is wrong by some parts in a thousand.

    Parameters
    ----------
    record : Record
        With `lateral` and `speed`, in order, else it is handed back.
    settings : IdentificationSettings
        Diameter of the roller, and the lines.

    Returns
    -------
    Record
        With the channel `roller`; without it where neither encoder nor diameter is known.
    """
    diameter = settings.roller_diameter_m
    if 'roller' in record and len(record['roller'].finite()) > 10:
        return _with_roller(record, _encoded(record, diameter))
    if not diameter or not all(
        name in record and len(record[name]) > 10 for name in ('lateral', 'speed')
    ):
        return record
    motion, told = record['lateral'], record['speed'].finite()
    if not len(told) or not len(motion.finite()) or not settings.orders.size:
        return record
    time, lateral = motion.seconds(), motion.values
    running = np.interp(time, told.seconds(int(motion.stamps_ns[0])), np.abs(told.values))
    turning = running * 2.0 / diameter
    angle = cumulative_trapezoid(turning, time, initial=0.0)
    angle = follow_lines(time, lateral, angle, settings.orders)
    return _with_roller(record, Series(motion.stamps_ns, angle))


def _encoded(record: Record, diameter_m: float) -> Series:
    """
    Return the angle of an encoder, by the speed where that wraps between two readings.

    Steps that are a turn short show it: they follow the speed with another ratio, 2 / D, than
    they seem to; the true one has the steps in phase with what the speed tells.
    """
    encoder = record['roller'].finite()
    wraps = len(encoder) > 10 and float(np.ptp(encoder.values)) < _WITHIN
    if 'speed' not in record or not wraps:
        return continuous(record['roller'])
    told = record['speed'].finite()
    time = encoder.seconds(record.start_ns)
    speed = np.interp(time, told.seconds(record.start_ns), np.abs(told.values))
    way, step = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time), np.diff(encoder.values)
    ratios = 2.0 / np.array([diameter_m]) if diameter_m else np.linspace(*_RATIOS)
    ratios = np.concatenate([ratios, -ratios])
    some = slice(None, None, max(step.size // 2000, 1))
    phases = np.exp(1j * (step[some] - ratios[:, None] * way[some]))
    turned = ratios[int(np.argmax(np.abs(phases.mean(axis=1))))] * way
    if not np.median(np.abs(turned)) > _HALF:
        return continuous(record['roller'])
    angle = np.cumsum(turned + (step - turned + np.pi) % (2.0 * np.pi) - np.pi)
    return Series(encoder.stamps_ns, encoder.values[0] + np.concatenate([[0.0], angle]))


def _with_roller(record: Record, roller: Series) -> Record:
    return replace(record, channels={**record.channels, 'roller': roller})


def follow_lines(time: _F, values: _F, angle: _F, orders: _F) -> _F:
    """
    Correct an angle by what the phases of the lines turn against it.

    The signal is demodulated at each line; what the phasor turns from window to window is the
    relative error of the turning, averaged with the weight of the lines that show it, and with
    that of what a tachometer is known to.

    Parameters
    ----------
    time, values, angle : ndarray, shape (n,)
        s; the signal, in any unit, NaN where missing; angle, rad.
    orders : ndarray, shape (k,)
        Lines, in turns of the angle.

    Returns
    -------
    ndarray, shape (n,)
        rad.
    """
    good = np.isfinite(values)
    cell = np.floor((time - time[0]) / _CELL_S).astype(np.int64)
    count = int(cell[-1]) + 1
    every = round(0.5 * _WINDOW_S / _CELL_S)
    window = np.hanning(2 * every + 1)
    if count < 4 * every or not good.any():
        return angle
    centred = values[good] - np.median(values[good])
    # Windows one half apart: the angle and the time at their middles.
    middles = np.arange(every, count - every, every)
    turned = np.diff(np.interp((middles + 0.5) * _CELL_S, time - time[0], angle))
    information = np.full(turned.size, 1.0 / SPEED_STD**2)
    weighted = np.zeros(turned.size)
    width = _STEADY_S / (every * _CELL_S)
    independent = np.sqrt(np.pi) * width  # windows that overlap by half, under the weight
    seen = np.convolve(np.bincount(cell[good], minlength=count), window, 'same')[middles]
    for order in orders:
        mixed = centred * np.exp(-1j * order * angle[good])
        summed = np.bincount(cell[good], mixed.real, minlength=count) + 1j * np.bincount(
            cell[good], mixed.imag, minlength=count
        )
        phasor = np.convolve(summed, window, 'same')[middles]
        phasor /= np.maximum(seen, 1e-9)
        product = phasor[1:] * np.conj(phasor[:-1])
        smooth = _smooth(product.real, width) + 1j * _smooth(product.imag, width)
        coherence = np.abs(smooth) / np.maximum(_smooth(np.abs(product), width), 1e-300)
        coherence = np.clip(coherence, 1e-6, 1.0 - 1e-6)
        variance = (1.0 - coherence**2) / (2.0 * coherence**2 * independent)
        known = (order * turned) ** 2 / variance
        slip = np.divide(
            np.angle(smooth), order * turned, out=np.zeros_like(turned), where=turned > 0.0
        )
        weighted += np.where(np.abs(slip) < _MOST, known * slip, 0.0)
        information += np.where(np.abs(slip) < _MOST, known, 0.0)
    at = (0.5 * (middles[1:] + middles[:-1]) + 0.5) * _CELL_S
    slip = np.interp(time - time[0], at, weighted / information)
    corrected = np.diff(angle) * (1.0 + 0.5 * (slip[1:] + slip[:-1]))
    found: _F = angle[0] + np.concatenate([[0.0], np.cumsum(corrected)])
    return found


def _smooth(values: _F, width: float) -> _F:
    return np.asarray(gaussian_filter1d(values, width, mode='nearest'))
