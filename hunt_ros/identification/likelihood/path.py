"""The measured path: the envelope of all records in a row, in the variables of the fit."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Path:
    """
    The envelope of all records in a row, in the variables of the fit.

    Parameters
    ----------
    time : ndarray, shape (n,)
        s, rising within each run, evenly.
    u : ndarray, shape (n,)
        v / v_ref - 1.
    phasor : ndarray of complex, shape (n,)
        z / A_ref; NaN where nothing was measured.
    restart : ndarray of bool, shape (n,)
        True where a run begins.
    blur : float
        Variance of the window in which each phasor was measured, s^2.
    reach : float
        Mean distance of two instants of such a window, s.
    overlap : float
        Correlation of the noise of neighbouring windows, below 1/2.
    turn : float
        Angle by which the hunting turns in a step, rad.
    line : ndarray, shape (n,), optional
        Power (B / A_ref)^2 of the lines that the roller forces on y beside hunting.
    recording : ndarray of int, shape (n,), optional
        Recording each instant belongs to, 0-based and in a row; all to one where it is not given.
        Of one recording whose speed is coarse: the hold.
    hold_std : float
        Standard deviation of the true speed of a hold about the coarse one, over v_ref; 0: fine.
    """

    time: NDArray[np.float64]
    u: NDArray[np.float64]
    phasor: NDArray[np.complex128]
    restart: NDArray[np.bool_]
    blur: float = 0.0
    reach: float = 0.0
    overlap: float = 0.0
    turn: float = math.inf
    line: NDArray[np.float64] | None = None
    recording: NDArray[np.int64] | None = None
    hold_std: float = 0.0

    @cached_property
    def recordings(self) -> list[Path]:
        """The paths of the recordings, one by one."""
        if self.recording is None or not self.recording.any():
            return [self]
        edges = np.searchsorted(self.recording, np.arange(int(self.recording.max()) + 2))
        return [self._part(slice(a, b)) for a, b in itertools.pairwise(edges.tolist())]

    def _part(self, place: slice) -> Path:
        """Return the path of one recording."""
        traces = {name: getattr(self, name)[place] for name in ('time', 'u', 'phasor', 'restart')}
        line = None if self.line is None else self.line[place]
        return replace(self, **traces, line=line, recording=None)

    @cached_property
    def beyond(self) -> NDArray[np.float64]:
        """
        Variance of the second order of averaging on the way to each instant, shape (n,).

        The law is that of the motion averaged over a cycle, right to first order of growth rate
        over angular frequency: what grows fast leaves it, and a jump overshoots the limit cycle.
        The second order is A g dg/d(ln A) / omega a second, A times the second difference of ln A
        over the angle of a step, seen at both ends. By the path and not by the law, which would
        bend to explain noise by it.

        References
        ----------
        Sanders, J. A., Verhulst, F., Murdock, J. (2007), Averaging Methods in Nonlinear Dynamical
        Systems, Sect. 2.9.
        """
        size = np.abs(self.phasor)
        log = np.log(np.where(size > 0.0, size, np.nan))
        bend = np.nan_to_num(np.pad(np.diff(log, 2), 1)) ** 2
        bend[1:] = 0.5 * (bend[1:] + bend[:-1])
        found: NDArray[np.float64] = np.nan_to_num(size) ** 2 * bend / self.turn**2
        return found

    @cached_property
    def starts(self) -> NDArray[np.bool_]:
        """
        Instants at which a segment begins, shape (n,): the amplitude there is free.

        Each run begins one, and each gap: what went on in a gap is not known (the speed may
        have gone anywhere, random motion may have decided for another state), so that no law
        is integrated over it.
        """
        known = np.isfinite(self.phasor)
        before = np.concatenate([[False], known[:-1]])
        starts: NDArray[np.bool_] = known & (self.restart | ~before)
        return starts

    def broken_at(self, jumps: NDArray[np.bool_]) -> Path:
        """Return the path with new segments after `jumps`, whose windows are left out."""
        hit = jumps.copy()
        hit[:-1] |= jumps[1:]
        hit[1:] |= jumps[:-1] & ~self.restart[1:]
        return replace(self, phasor=np.where(hit, np.nan, self.phasor))
