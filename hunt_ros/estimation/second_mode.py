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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.response_windows import BINS, PERIODS, SAME_SPEED, WINDOW, ResponseWindows
from hunt_ros.estimation.spectrum import Whittle, inverse

_F = NDArray[np.float64]
_C = NDArray[np.complex128]

#: Windows below which nothing is said, and levels of the speed at most.
_FEWEST, _LEVELS = 12, 40
#: A window with so many times the power of its level in a sensor holds a blow, or a spike.
_LOUD = 4.0
#: Bins about the hunting that are left out, on either side.
_GUARD = 2.0
#: The shares of Hann's window in half bins on either side of a bin, and the half bins.
_SHARES = np.array([0.0288, 0.25, 0.7205, 1.0, 0.7205, 0.25, 0.0288])
_SHARES /= _SHARES.sum()
_FINE = np.arange(BINS[0] - 1.5, BINS[-1] + 1.6, 0.5)
#: What the averaging into cells leaves of a motion; the noise of the samples stays white.
_GAIN = np.sinc(BINS / WINDOW) ** 2
#: Windows that overlap by half are worth this many, each, and neighbouring bins this many: the
#: correlations of Hann's window (Welch, IEEE Trans. Audio Electroacoust. 15, 1967).
_OVERLAPPING, _NEIGHBOURS = 0.947, 0.515
#: A bin that stands out of the law by so many standard deviations holds a line.
_OUTLIER, _PASSES = 4.0, 4
#: The law is refused where the spectra scatter about it by more than this, in variances,
_SCATTER = 2.0
#: or where lines leave less than this part of the bins.
_LEFT = 0.9
#: What is known of the second mode of any wheelset: logarithms of its decay and frequency over the
#: frequency of hunting, with their standard deviations (of random rigs that can hunt). What the
#: spectra put further off than this many is a line that nobody named, or the hunting once more.
#: The ratio of the hunting has what is known of it; the other parameters have no prior.
_PARAMETERS, _FURTHEST = 11, 2.5
_USUAL = np.array([-0.2, -0.15, *[0.0] * (_PARAMETERS - 2)])
_USUAL_STD = np.array([0.6, 0.3, *[math.inf] * (_PARAMETERS - 4), 0.0, 0.0])
#: No ratio is known better, relative.
_LEAST_STD = 1e-3
#: Evaluations in a search.
_TURNS = 200


@dataclass(frozen=True, eq=False)
class HuntingMode:
    """
    What is known of the hunting mode at small amplitudes, at one speed.

    Parameters
    ----------
    speed : float
        m/s; best in the middle of those of the windows.
    eigenvalue : complex
        1/s, of positive imaginary part.
    ratio : complex
        Yaw over lateral phasor, rad/m.
    ratio_std : float
        Its relative standard deviation.
    """

    speed: float
    eigenvalue: complex
    ratio: complex
    ratio_std: float = 0.0


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
        Standard deviation of its eigenvalue over the modulus; that of the ratio of the hunting
        is in it.
    """

    speeds: _F
    frequency_hz: _F
    decay: _F
    relative_std: float


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
        The other mode.

    Returns
    -------
    SecondMode or None
        At the speeds of the windows; None where they are too few, where the law does not
        describe them, or where what it finds is no second mode of a wheelset.
    """
    if windows.speed.size < _FEWEST:
        return None
    levels = _Levels.of(windows)
    if not np.all(levels.unit > 0.0):
        return None
    try:
        with np.errstate(all='ignore'):
            return _fitted(_Fit(levels, frequency_hz, hunting), hunting)
    except np.linalg.LinAlgError:
        return None


def _fitted(fit: _Fit, hunting: HuntingMode) -> SecondMode | None:
    """Return the mode of best fit, if it is one."""
    if not fit.enough:
        return None
    theta = fit.whittle.least(fit.start(), _TURNS)
    for _ in range(_PASSES):
        if theta is None or not fit.leave_out_lines(theta):
            break
        if not fit.enough:
            return None
        theta = fit.whittle.least(theta, _TURNS)
    if theta is None:
        return None
    scatter = fit.scatter(theta)
    if not (
        scatter < _SCATTER and np.all(np.abs(theta - _USUAL)[:2] < _FURTHEST * _USUAL_STD[:2])
    ):
        return None
    eigenvalue = fit.eigenvalues(theta)
    if eigenvalue is None:
        return None
    covariance = max(scatter, 1.0) * np.linalg.inv(fit.whittle.slopes(theta)[1])
    parts = np.exp(theta[:2])
    variance = float(np.sum(parts**2 * np.diag(covariance)[:2]))
    if not 0.0 < variance < math.inf:
        return None
    std = math.sqrt(variance) / math.hypot(*parts)
    return SecondMode(fit.speed, eigenvalue.imag / (2.0 * math.pi), -eigenvalue.real, std)


@dataclass(frozen=True, eq=False)
class _Levels:
    """
    The windows by speed.

    Parameters
    ----------
    speed : ndarray, shape (n,)
        m/s.
    unit : ndarray, shape (2,)
        Root of the median power of either sensor.
    spectra : ndarray of complex, shape (n, bins, 2, 2)
        Means over the windows of a level, in these units.
    windows : ndarray, shape (n, bins)
        How many independent windows are in them.
    """

    speed: _F
    unit: _F
    spectra: _C
    windows: _F

    @classmethod
    def of(cls, windows: ResponseWindows) -> _Levels:
        """Sort windows by their speed, and leave out those that are loud for it."""
        logarithm = np.log(windows.speed)
        width = max(SAME_SPEED, float(np.ptp(logarithm)) / _LEVELS)
        level = np.round(logarithm / width).astype(np.int64)
        _, level = np.unique(level, return_inverse=True)
        count = int(level.max()) + 1
        clear = np.abs(BINS - PERIODS) > _GUARD
        power = np.einsum('wbkk->wk', windows.spectra[:, clear]).real
        usual = np.stack([np.median(power[level == k], axis=0) for k in range(count)])
        calm = np.all(power <= _LOUD * usual[level], axis=1)
        taken = (windows.usable & clear)[calm].astype(np.float64)
        speed, number, held = np.zeros(count), np.zeros(count), np.zeros((count, BINS.size))
        spectra = np.zeros((count, BINS.size, 2, 2), dtype=np.complex128)
        np.add.at(speed, level[calm], windows.speed[calm])
        np.add.at(number, level[calm], 1.0)
        np.add.at(held, level[calm], taken)
        np.add.at(spectra, level[calm], taken[:, :, None, None] * windows.spectra[calm])
        spectra /= np.maximum(held, 1.0)[:, :, None, None]
        powers = np.einsum('lbkk->lbk', spectra).real[held > 0.0]
        unit = np.sqrt(np.median(powers, axis=0)) if powers.size else np.zeros(2)
        scale = np.outer(unit, unit) if np.all(unit > 0.0) else np.ones((2, 2))
        return cls(speed / number, unit, spectra / scale, _OVERLAPPING * held)


class _Fit:
    """
    The law beside the levels, in units of its own: of hunting in time, of the sensors in size.

    Parameters theta: logarithms of decay and frequency of the second mode; its ratio, real and
    imaginary; the factor L of Q = L L^T, its diagonal as logarithms; logarithms of R; how far the
    ratio of the hunting is from what is known of it, relative, real and imaginary.
    """

    def __init__(self, levels: _Levels, frequency_hz: float, hunting: HuntingMode) -> None:
        self.speed = levels.speed
        std = _USUAL_STD.copy()
        std[9:] = max(hunting.ratio_std, _LEAST_STD)
        weight = _NEIGHBOURS * levels.windows
        self.whittle = Whittle(self._expected, levels.spectra, weight, _USUAL, std)
        self._all = int(np.count_nonzero(levels.windows))
        self._omega = 2.0 * math.pi * frequency_hz
        self._s = 1j * _FINE / PERIODS
        self._slow = hunting.speed / levels.speed
        self._hunting = replace(
            hunting,
            eigenvalue=hunting.eigenvalue / self._omega,
            ratio=hunting.ratio * levels.unit[0] / levels.unit[1],
        )

    @property
    def enough(self) -> bool:
        """Whether lines have left most of the bins, and more than there are parameters."""
        left = int(np.count_nonzero(self.whittle.weight))
        return left > 2 * _PARAMETERS and left >= _LEFT * self._all

    def start(self) -> _F:
        """Return a first guess: a mode that dies within a period, its ratio turned."""
        ratio = 1j * self._hunting.ratio
        theta = np.zeros(_PARAMETERS)
        theta[:4] = math.log(0.5), 0.1, ratio.real, ratio.imag
        theta[[4, 6]] = 0.5 * math.log(0.5)
        level = float(np.median(self.whittle.seen(theta)[self.whittle.weight > 0.0]))
        theta[[4, 6]] += 0.5 * math.log(max(level, 1e-300))
        theta[7:9] += math.log(max(level, 1e-300))
        return theta

    def _law(self, theta: _F) -> tuple[_F, _F]:
        """Return C and K, both of shape (2, 2), whose modes are the two."""
        second = complex(-math.exp(theta[0]), math.exp(theta[1]))
        eigenvalues = np.array([self._hunting.eigenvalue, second])
        ratio = self._hunting.ratio * complex(1.0 + theta[9], theta[10])
        shapes = np.array([[1.0, 1.0], [ratio, complex(theta[2], theta[3])]])
        known = np.concatenate([shapes * eigenvalues, shapes])
        wanted = -shapes * eigenvalues**2
        both = np.linalg.solve(
            np.concatenate([known, known.conj()], axis=1).T,
            np.concatenate([wanted, wanted.conj()], axis=1).T,
        ).T.real
        return both[:, :2], both[:, 2:]

    def _expected(self, theta: _F) -> _C | None:
        """Return the cross-spectra that are expected, shape (levels, bins, 2, 2); None: none."""
        try:
            damping, stiffness = self._law(theta)
            force = np.array([[math.exp(theta[4]), 0.0], [theta[5], math.exp(theta[6])]])
        except (np.linalg.LinAlgError, OverflowError):
            return None
        s = self._s[None, :, None, None]
        response = inverse(
            s * s * np.eye(2) + s * self._slow[:, None, None, None] * damping + stiffness
        )
        driven = response @ force
        fine = driven @ driven.conj().swapaxes(-1, -2)
        seen = np.zeros((fine.shape[0], BINS.size, 2, 2), dtype=np.complex128)
        for k, share in enumerate(_SHARES):
            seen += share * fine[:, k : k + 2 * BINS.size : 2]
        expected: _C = seen * _GAIN[:, None, None] + np.diag(np.exp(theta[7:9]))
        return expected

    def _off(self, theta: _F) -> _F:
        """Return how far the spectra are above the law, in standard deviations; 0: left out."""
        windows = self.whittle.weight / _NEIGHBOURS
        off: _F = np.sqrt(2.0 * windows) * (self.whittle.seen(theta) - 1.0)
        return off

    def leave_out_lines(self, theta: _F) -> bool:
        """Leave out the bins that stand out; return False where there are none."""
        lines = self._off(theta) > _OUTLIER
        self.whittle.weight[lines] = 0.0
        return bool(lines.any())

    def scatter(self, theta: _F) -> float:
        """Return the variance of the spectra about the law, over that of as many windows."""
        freedom = np.count_nonzero(self.whittle.weight) - theta.size
        return float(np.sum(self._off(theta) ** 2) / max(freedom, 1))

    def eigenvalues(self, theta: _F) -> _C | None:
        """Return those of the second mode at each level, 1/s; None: it does not ring out."""
        damping, stiffness = self._law(theta)
        if not -math.exp(theta[0]) < self._hunting.eigenvalue.real:
            return None
        found = []
        for slow in self._slow:
            system = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -slow * damping]])
            turning = [value for value in np.linalg.eigvals(system) if value.imag > 1e-6]
            # It is the one of the two that is damped more.
            value = min(turning, key=lambda one: one.real, default=0j)
            if len(turning) < 2 or not value.real < 0.0:
                return None
            found.append(value)
        return np.array(found, dtype=np.complex128) * self._omega
