"""
When each message of a recording is due in a live replay: rate, pause, loop.

Pure: the time is given with every call, in nanoseconds of any clock that does not
jump. The node around it publishes what is due, and the replay's own clock.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hunt_ros.errors import ConfigError
from hunt_ros.samples import NANOSECONDS

SLOWEST, FASTEST = 0.1, 50.0


class ReplaySchedule:
    """
    Paces a replay.

    Parameters
    ----------
    stamps_ns : array_like of int64, shape (n,)
        Recorded times, not decreasing.
    rate : float
        Recorded seconds in a second, 0.1 to 50.
    from_s, to_s : float, optional
        Part to play, in s since the first stamp; both ends included.
    loop : bool
        Begin anew at the end.

    Raises
    ------
    ConfigError
        If there is nothing to play, or the rate is out of range.
    """

    def __init__(
        self,
        stamps_ns: ArrayLike,
        *,
        rate: float = 1.0,
        from_s: float = 0.0,
        to_s: float | None = None,
        loop: bool = False,
    ) -> None:
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        if not stamps.size:
            raise ConfigError('replay: there is no message to play')
        origin, last = int(stamps[0]), int(stamps[-1])
        self._stamps = stamps
        self._begin_ns = origin + round(from_s * NANOSECONDS)
        self._end_ns = last if to_s is None else min(last, origin + round(to_s * NANOSECONDS))
        self._first = int(np.searchsorted(stamps, self._begin_ns, 'left'))
        self._last = int(np.searchsorted(stamps, self._end_ns, 'right'))
        if from_s < 0.0 or self._first >= self._last:
            raise ConfigError(
                f'replay: no message from {from_s:g} s to {(self._end_ns - origin) / 1e9:g} s'
            )
        self._loop = loop
        self._rate = _checked(rate)
        self._next = self._first
        self._anchor_ns: int | None = None  # of the caller's clock; None while it stands
        self._position_ns = self._begin_ns

    @property
    def rate(self) -> float:
        """Recorded seconds in a second."""
        return self._rate

    @property
    def playing(self) -> bool:
        """Whether time goes on."""
        return self._anchor_ns is not None

    @property
    def finished(self) -> bool:
        """Whether everything was due, and it does not loop."""
        return self._next >= self._last and not self._loop

    def play(self, now_ns: int) -> None:
        """Start, or go on after a pause."""
        if self._anchor_ns is None:
            self._anchor_ns = now_ns

    def pause(self, now_ns: int) -> None:
        """Stop the replay's time; nothing is due until `play`."""
        self._position_ns = self.time_ns(now_ns)
        self._anchor_ns = None

    def set_rate(self, now_ns: int, rate: float) -> None:
        """
        Change the rate from now on.

        Raises
        ------
        ConfigError
            If it is not within 0.1 to 50.
        """
        rate = _checked(rate)
        self._position_ns = self.time_ns(now_ns)
        if self._anchor_ns is not None:
            self._anchor_ns = now_ns
        self._rate = rate

    def time_ns(self, now_ns: int) -> int:
        """Recorded time that the replay has reached, ns: what `/clock` says."""
        if self._anchor_ns is None:
            return self._position_ns
        passed = int((now_ns - self._anchor_ns) * self._rate)
        return min(self._position_ns + max(0, passed), self._end_ns)

    def due(self, now_ns: int) -> range:
        """
        Return the numbers of the messages that are due and were not yet; a round's rest first.

        Parameters
        ----------
        now_ns : int
            Now; not before the last call's.
        """
        if self._anchor_ns is None:
            return range(self._next, self._next)
        if self._loop and self._next >= self._last:
            # The next round begins when this one ended, however late the call comes.
            self._anchor_ns += round((self._end_ns - self._position_ns) / self._rate)
            self._position_ns, self._next = self._begin_ns, self._first
        begin = self._next
        if now_ns >= self._anchor_ns:
            end = int(np.searchsorted(self._stamps, self.time_ns(now_ns), 'right'))
            self._next = min(max(end, begin), self._last)
        return range(begin, self._next)

    def wait_ns(self, now_ns: int) -> int | None:
        """
        Return how long until the next message is due, ns.

        Returns
        -------
        int or None
            None where nothing will be: paused, or finished.
        """
        if self._anchor_ns is None or self.finished:
            return None
        target = self._end_ns if self._next >= self._last else int(self._stamps[self._next])
        ahead = (target - self._position_ns) / self._rate
        return max(0, self._anchor_ns + int(np.ceil(ahead)) - now_ns)


def _checked(rate: float) -> float:
    if not SLOWEST <= rate <= FASTEST:
        raise ConfigError(f'replay: rate {rate:g} is not within {SLOWEST:g} to {FASTEST:g}')
    return float(rate)
