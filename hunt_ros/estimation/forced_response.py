"""
The second mode, from what random forces make of both sensors together.

About rest the two coordinates q = (y, psi) of a wheelset that runs at v obey

    q'' + (v_0 / v) C q' + K q = f,

Eqs. (2), (3) linearised: the forces of creep go with 1/v. Under white forces f of covariance Q
the cross-spectral matrix of the sensors, whose noise has the variances R, is

    S(omega) = H Q H* + R,    H = (K - omega^2 + i omega (v_0 / v) C)^-1.

Two modes (eigenvalue and ratio of yaw to lateral, at v_0) make up C and K. One is the hunting,
which is known better from elsewhere; the other one is fitted, with Q and R, to the windows of
quiet running at all speeds (Whittle, J. R. Stat. Soc. B 15, 1953). The bins about the hunting,
whose peak is narrower than a window, and those of lines, known and found, are left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hunt_ros.samples import NANOSECONDS, Record

_F = NDArray[np.float64]
_C = NDArray[np.complex128]

#: Length of a window in periods of hunting, and cells in a period.
_PERIODS, _CELLS = 12, 16
_WINDOW = _PERIODS * _CELLS
#: Bins of a window that are used: from 0.3 to 4 times the frequency of hunting,
_BINS = np.arange(4, 4 * _PERIODS + 1)
#: and further from it than this, in bins: a peak may be narrower than a window.
_GUARD = 2.0
#: The shares of Hann's window in half bins on either side of a bin, and the half bins.
_SHARES = np.array([0.0288, 0.25, 0.7205, 1.0, 0.7205, 0.25, 0.0288])
_SHARES /= _SHARES.sum()
_FINE = np.arange(_BINS[0] - 1.5, _BINS[-1] + 1.6, 0.5)
#: What the averaging into cells leaves of a motion; the noise of the samples stays white.
_GAIN = np.sinc(_BINS / _WINDOW) ** 2
#: A known line takes this many bins with it on either side.
_LINE = 1.2
#: Windows looked at in one record: a long one is thinned evenly.
_MOST = 600
#: The speed of a window changes by less than this part, as in a slow sweep, and so do the speeds
#: of one level: the modes change by as little.
_SAME_SPEED = 0.02
#: Cells of a window that may be empty.
_LOST = 0.02
#: Windows that overlap by half are worth this many, each, and neighbouring bins this many: the
#: correlations of Hann's window (Welch, IEEE Trans. Audio Electroacoust. 15, 1967).
_OVERLAPPING, _NEIGHBOURS = 0.947, 0.515
#: A bin that stands out of the law by so many standard deviations holds a line.
_OUTLIER, _PASSES = 4.0, 4
#: The law is refused where the spectra scatter about it by more than this, in variances,
_SCATTER = 4.0
#: or where lines leave less than this part of the bins.
_LEFT = 0.7
#: Windows below which nothing is said.
_FEWEST = 12
#: Turns of the search, and how far one of them may go.
_TURNS = 100
_STEEPEST = 0.5


@dataclass(frozen=True, eq=False)
class ResponseWindows:
    """
    Windows of a recording in which the speed stands still.

    Parameters
    ----------
    speed, amplitude : ndarray, shape (k,)
        Mean speed, m/s; amplitude of the lateral motion without the known lines, m.
    spectra : ndarray of complex, shape (k, bins, 2, 2)
        Cross-spectral matrices of lateral and yaw at `frequencies`, two-sided: m^2 s, m rad s,
        rad^2 s.
    usable : ndarray of bool, shape (k, bins)
        No known line lies near the bin.
    """

    speed: _F
    amplitude: _F
    spectra: _C
    usable: NDArray[np.bool_]

    def only(self, kept: NDArray[np.bool_]) -> ResponseWindows:
        """Return some of the windows."""
        return ResponseWindows(
            self.speed[kept], self.amplitude[kept], self.spectra[kept], self.usable[kept]
        )


@dataclass(frozen=True, eq=False)
class HuntingMode:
    """
    What is known of the hunting mode at small amplitudes, at one speed.

    Parameters
    ----------
    speed : float
        m/s.
    eigenvalue : complex
        1/s, of positive imaginary part.
    ratio : complex
        Yaw over lateral phasor, rad/m.
    """

    speed: float
    eigenvalue: complex
    ratio: complex


@dataclass(frozen=True, eq=False)
class SecondMode:
    """
    The second mode by speed.

    Parameters
    ----------
    speeds : ndarray, shape (n,)
        m/s, increasing.
    frequency_hz, decay : ndarray, shape (n,)
        Hz; decay rate, 1/s, positive.
    relative_std : float
        Standard deviation of its eigenvalue over the modulus.
    """

    speeds: _F
    frequency_hz: _F
    decay: _F
    relative_std: float


def joined(windows: Sequence[ResponseWindows]) -> ResponseWindows:
    """Return the windows of several recordings as those of one."""
    return ResponseWindows(
        np.concatenate([one.speed for one in windows]),
        np.concatenate([one.amplitude for one in windows]),
        np.concatenate([one.spectra for one in windows]),
        np.concatenate([one.usable for one in windows]),
    )


def measure_response(
    record: Record, frequency_hz: float, orders: Sequence[float] = (1.0, 2.0)
) -> ResponseWindows:
    """
    Take the cross-spectra of both sensors in windows of 12 periods that overlap by half.

    Parameters
    ----------
    record : Record
        With `lateral`, `yaw` and `speed`; `roller` where there is one.
    frequency_hz : float
        Of the hunting.
    orders : sequence of float
        Known lines, in turns of the roller; removed where its angle is known.

    Returns
    -------
    ResponseWindows
        Empty where a sensor is missing, or takes fewer than 16 samples a period.
    """
    cells = _cells(record, 1.0 / (_CELLS * frequency_hz))
    starts = np.arange(0, cells['lateral'].size - _WINDOW + 1, _WINDOW // 2)
    if starts.size > _MOST:
        starts = starts[np.linspace(0, starts.size - 1, _MOST).astype(np.int64)]
    taper = np.hanning(_WINDOW + 1)[:_WINDOW]
    taper /= math.sqrt(float(taper @ taper))
    step = 1.0 / (_CELLS * frequency_hz)
    x = np.linspace(-1.0, 1.0, _WINDOW)
    speeds: list[float] = []
    amplitudes: list[float] = []
    spectra: list[_C] = []
    usable: list[NDArray[np.bool_]] = []
    for start in starts:
        part = slice(int(start), int(start) + _WINDOW)
        motion = np.stack([cells['lateral'][part], cells['yaw'][part]], axis=1)
        lost = ~np.isfinite(motion).all(axis=1)
        v = cells['speed'][part]
        mean = abs(float(v.mean()))
        change = float(np.ptp(v.reshape(4, -1).mean(axis=1)))
        if np.count_nonzero(lost) > _LOST * _WINDOW or not change < _SAME_SPEED * mean:
            continue
        if lost.any():
            for k in range(2):
                motion[lost, k] = np.interp(x[lost], x[~lost], motion[~lost, k])
        angle = cells['roller'][part]
        columns, free = [np.ones(_WINDOW), x], np.ones(_BINS.size, dtype=np.bool_)
        if np.isfinite(angle).all():
            turning = abs(float(angle[-1] - angle[0])) / (2.0 * math.pi * (_WINDOW - 1))
            for order in orders:
                columns += [np.cos(order * angle), np.sin(order * angle)]
                free &= np.abs(_BINS - order * turning * _WINDOW) > _LINE
        basis = np.stack(columns, axis=1)
        motion -= basis @ np.linalg.lstsq(basis, motion, rcond=None)[0]
        lines = np.fft.rfft(motion * taper[:, None], axis=0)[_BINS]
        speeds.append(mean)
        amplitudes.append(math.sqrt(2.0) * float(np.std(motion[:, 0])))
        spectra.append(step * lines[:, :, None] * lines[:, None, :].conj())
        usable.append(free)
    return ResponseWindows(
        np.array(speeds),
        np.array(amplitudes),
        np.array(spectra, dtype=np.complex128).reshape(-1, _BINS.size, 2, 2),
        np.array(usable, dtype=np.bool_).reshape(-1, _BINS.size),
    )


def _cells(record: Record, step_s: float) -> dict[str, _F]:
    """Return the channels as means over cells of a common grid; NaN where a cell is empty."""
    nothing = {name: np.zeros(0) for name in ('lateral', 'yaw', 'speed', 'roller')}
    if any(name not in record or len(record[name]) < 2 for name in ('lateral', 'yaw', 'speed')):
        return nothing
    both = [record[name].stamps_ns for name in ('lateral', 'yaw')]
    start = int(max(stamps[0] for stamps in both))
    length = (int(min(stamps[-1] for stamps in both)) - start) / NANOSECONDS
    count = max(int(length / step_s), 0)
    middle = step_s * (np.arange(count) + 0.5)
    found = {'roller': np.full(count, math.nan)}
    for name in ('lateral', 'yaw', 'speed', 'roller'):
        if name not in record:
            continue
        series = record[name]
        good = np.isfinite(series.values)
        seconds = (series.stamps_ns[good] - start) / NANOSECONDS
        values = series.values[good]
        if name in ('lateral', 'yaw'):
            place = np.floor(seconds / step_s)
            inside = (place >= 0) & (place < count)
            cell = place[inside].astype(np.int64)
            samples = np.bincount(cell, minlength=count)
            total = np.bincount(cell, weights=values[inside], minlength=count)
            found[name] = np.divide(
                total, samples, out=np.full(count, math.nan), where=samples > 0
            )
        elif values.size > 1:
            found[name] = np.interp(middle, seconds, values)
    return found if 'speed' in found else nothing


def second_mode(
    windows: ResponseWindows, frequency_hz: float, hunting: HuntingMode
) -> SecondMode | None:
    """
    Fit the second mode to windows of quiet running.

    Parameters
    ----------
    windows : ResponseWindows
        In which the motion is small enough to be linear.
    frequency_hz : float
        With which the windows were taken.
    hunting : HuntingMode
        At a speed among those of the windows.

    Returns
    -------
    SecondMode or None
        At the speeds of the windows; None where they are too few, where the law does not
        describe them, or where no second mode oscillates.
    """
    if windows.speed.size < _FEWEST:
        return None
    fit = _Fit(windows, frequency_hz, hunting)
    theta = min((fit.best(fit.start(turn)) for turn in (1j, -1j)), key=fit.misfit)
    for _ in range(_PASSES):
        if not fit.leave_out_lines(theta):
            break
        theta = fit.best(theta)
    scatter = fit.scatter(theta)
    if not scatter < _SCATTER or fit.left < _LEFT:
        return None
    std = fit.relative_std(theta) * math.sqrt(max(scatter, 1.0))
    eigenvalue = fit.eigenvalues(theta)
    if eigenvalue is None or not math.isfinite(std):
        return None
    return SecondMode(fit.speed, eigenvalue.imag / (2.0 * math.pi), -eigenvalue.real, std)


class _Fit:
    """
    The law and the levels in units of their own: of hunting in time, of the sensors in size.

    Parameters theta: logarithms of decay and frequency of the second mode; its ratio, real and
    imaginary; the factor L of Q = L L^T, its diagonal as logarithms; logarithms of R.
    """

    def __init__(
        self, windows: ResponseWindows, frequency_hz: float, hunting: HuntingMode
    ) -> None:
        level = np.round(np.log(windows.speed) / _SAME_SPEED).astype(np.int64)
        _, level, count = np.unique(level, return_inverse=True, return_counts=True)

        def mean(values: NDArray[Any]) -> NDArray[Any]:
            """Return the mean over the windows of each level."""
            total = np.zeros((count.size, *values.shape[1:]), dtype=values.dtype)
            np.add.at(total, level, values)
            return total / count.reshape(-1, *[1] * (values.ndim - 1))

        self.speed: _F = mean(windows.speed)
        spectra = mean(windows.spectra)
        power = np.einsum('lbkk->lbk', spectra).real
        self._unit = np.sqrt(np.median(power, axis=(0, 1)))
        self._spectra = spectra / np.outer(self._unit, self._unit)
        self._omega = 2.0 * math.pi * frequency_hz
        clear = np.abs(_BINS - _PERIODS) > _GUARD
        usable = mean(windows.usable.astype(np.float64)) > 0.5
        self._windows = _OVERLAPPING * count[:, None] * (usable & clear)
        self._used = int(np.count_nonzero(self._windows))
        self._s = 1j * _FINE / _PERIODS
        self._slow = hunting.speed / self.speed
        self._eigenvalue = hunting.eigenvalue / self._omega
        self._ratio = hunting.ratio * self._unit[0] / self._unit[1]

    def start(self, turn: complex) -> _F:
        """Return a first guess: a mode that dies within a period, its ratio turned."""
        ratio = self._ratio * turn
        theta = np.array([math.log(0.5), 0.1, ratio.real, ratio.imag, 0, 0, 0, 0, 0], np.float64)
        theta[[4, 6]] = 0.5 * math.log(0.5)
        matrix = np.linalg.inv(self._expected(theta)) @ self._spectra
        level = math.log(float(np.median(np.trace(matrix, axis1=-2, axis2=-1).real)) / 2.0)
        theta[[4, 6]] += 0.5 * level
        theta[7:] += level
        return theta

    def _law(self, theta: _F) -> tuple[_F, _F]:
        """Return C and K, both of shape (2, 2), whose modes are the two."""
        second = complex(-math.exp(theta[0]), math.exp(theta[1]))
        eigenvalues = np.array([self._eigenvalue, second])
        shapes = np.array([[1.0, 1.0], [self._ratio, complex(theta[2], theta[3])]])
        known = np.concatenate([shapes * eigenvalues, shapes])
        wanted = -shapes * eigenvalues**2
        both = np.linalg.solve(
            np.concatenate([known, known.conj()], axis=1).T,
            np.concatenate([wanted, wanted.conj()], axis=1).T,
        ).T.real
        return both[:, :2], both[:, 2:]

    def _expected(self, theta: _F) -> _C:
        """Return the cross-spectra that are expected, shape (levels, bins, 2, 2)."""
        damping, stiffness = self._law(theta)
        force = np.array([[math.exp(theta[4]), 0.0], [theta[5], math.exp(theta[6])]])
        s = self._s[None, :, None, None]
        response = np.linalg.inv(
            s * s * np.eye(2) + s * self._slow[:, None, None, None] * damping + stiffness
        )
        driven = response @ force
        fine = driven @ driven.conj().swapaxes(-1, -2)
        seen = np.zeros((fine.shape[0], _BINS.size, 2, 2), dtype=np.complex128)
        for k, share in enumerate(_SHARES):
            seen += share * fine[:, k : k + 2 * _BINS.size : 2]
        expected: _C = seen * _GAIN[:, None, None] + np.diag(np.exp(theta[7:]))
        return expected

    def misfit(self, theta: _F) -> float:
        """Return minus Whittle's log-likelihood; infinite where it has none."""
        try:
            with np.errstate(all='ignore'):
                return self._misfit(self._expected(theta))
        except (np.linalg.LinAlgError, OverflowError):
            return math.inf

    def _misfit(self, expected: _C) -> float:
        determinant = np.linalg.det(expected).real
        if not np.all(determinant > 0.0):
            return math.inf
        traces = np.trace(np.linalg.inv(expected) @ self._spectra, axis1=-2, axis2=-1).real
        total = float(_NEIGHBOURS * np.sum(self._windows * (np.log(determinant) + traces)))
        return total if math.isfinite(total) else math.inf

    def _slopes(self, theta: _F) -> tuple[_F, _F]:
        """Return gradient and Fisher information of the misfit."""
        expected = self._expected(theta)
        inverse = np.linalg.inv(expected)
        slopes = []
        for k in range(theta.size):
            moved = theta.copy()
            moved[k] += 1e-6
            slopes.append(inverse @ ((self._expected(moved) - expected) / 1e-6))
        columns = np.stack(slopes)
        off = inverse @ (expected - self._spectra)
        weight = _NEIGHBOURS * self._windows
        gradient = np.einsum('lb,lbij,klbji->k', weight, off, columns, optimize=True).real
        information = np.einsum('lb,mlbij,klbji->mk', weight, columns, columns, optimize=True).real
        return gradient, information

    def best(self, theta: _F) -> _F:
        """Return the parameters of least misfit: Fisher's scoring, damped as by Levenberg."""
        value, damping = self.misfit(theta), 1e-2
        for _ in range(_TURNS):
            gradient, information = self._slopes(theta)
            scale = np.diag(np.diag(information) + 1e-12 * np.trace(information))
            while damping < 1e8:
                step = np.linalg.solve(information + damping * scale, -gradient)
                step /= max(1.0, float(np.abs(step).max()) / _STEEPEST)
                moved = self.misfit(theta + step)
                if moved < value:
                    break
                damping *= 4.0
            else:
                return theta
            gained, theta, value, damping = value - moved, theta + step, moved, damping / 5.0
            if gained < 1e-3:
                break
        return theta

    def _off(self, theta: _F) -> _F:
        """Return how far the spectra are above the law, in standard deviations; 0: left out."""
        inverse = np.linalg.inv(self._expected(theta))
        above = 0.5 * np.trace(inverse @ self._spectra, axis1=-2, axis2=-1).real - 1.0
        off: _F = np.sqrt(2.0 * self._windows) * above
        return off

    def leave_out_lines(self, theta: _F) -> bool:
        """Leave out the bins that stand out; return False where there are none."""
        lines = self._off(theta) > _OUTLIER
        self._windows[lines] = 0.0
        return bool(lines.any())

    @property
    def left(self) -> float:
        """Share of the bins that hold no line that was found."""
        return np.count_nonzero(self._windows) / max(self._used, 1)

    def scatter(self, theta: _F) -> float:
        """Return the variance of the spectra about the law, over that of as many windows."""
        freedom = np.count_nonzero(self._windows) - theta.size
        return float(np.sum(self._off(theta) ** 2) / max(freedom, 1))

    def relative_std(self, theta: _F) -> float:
        """Return the standard deviation of the second eigenvalue over its modulus."""
        try:
            covariance = np.linalg.inv(self._slopes(theta)[1])
        except np.linalg.LinAlgError:
            return math.inf
        parts = np.exp(theta[:2])
        variance = float(np.sum(parts**2 * np.diag(covariance)[:2]))
        return math.sqrt(variance) / math.hypot(*parts) if variance >= 0.0 else math.inf

    def eigenvalues(self, theta: _F) -> _C | None:
        """Return the eigenvalue of the second mode at each level, 1/s; None: it oscillates not."""
        damping, stiffness = self._law(theta)
        found = []
        for slow in self._slow:
            system = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -slow * damping]])
            values = np.linalg.eigvals(system)
            oscillating = values[values.imag > 0.0]
            if oscillating.size < 2:
                return None
            found.append(oscillating[np.argmin(oscillating.real)])
        return np.array(found, dtype=np.complex128) * self._omega
