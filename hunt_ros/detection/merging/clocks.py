"""
The clock of one channel, seen from that of the detector.

The delay of a sample is the time from its stamp to the tick after which it was there. A
delay has a part that changes, the way through the network, and one that stays: how far the
two clocks are apart. The least delay over some seconds is their offset, and what exceeds it
is how late the channel is now. This is the minimum-delay filter of NTP (Mills, 1991, IEEE
Transactions on Communications 39, 1482-1493).
"""

from __future__ import annotations

from collections import deque

#: The least delay is taken over this time: longer than a network holds samples back while they
#: keep coming; in it clocks that drift by 100 ppm move by 0.2 ms.
_WINDOW_NS = 2_000_000_000
#: ... and over this many ticks at least: those of a machine that is too busy may all be late.
_LEAST = 10


class ChannelClock:
    """
    Follows the offset of a channel's clock.

    Parameters
    ----------
    limit_ns : int
        A clock that is further away is not believed.

    Attributes
    ----------
    shift_ns : int
        Added to the stamps of the channel as they arrive.
    offset_ns : int or None
        The detector's clock less that of the channel, ns; None before the first sample.
    late_ns : int
        By how much the newest sample was older than that at the last tick, ns, and at least the
        time in which none came: the detector's clock may be set back meanwhile.
    fresh : bool
        Samples had come since the tick before.
    """

    def __init__(self, limit_ns: int) -> None:
        self.limit_ns = limit_ns
        self.shift_ns = 0
        self.offset_ns: int | None = None
        self.late_ns = 0
        self.fresh = False
        self._last_tick_ns: int | None = None
        self._silence_ns = 0
        self._newest_ns: int | None = None  # stamp as it came
        self._taken = False
        #: Ticks after which new samples were there, and the delay then.
        self._delays: deque[tuple[int, int]] = deque()

    def take(self, newest_ns: int) -> None:
        """Take in the newest accepted stamp, as the channel's own clock tells it."""
        self._newest_ns = newest_ns
        self._taken = True

    def begin_anew(self) -> None:
        """The channel's clock was set: what was known of it counts no more."""
        self._delays.clear()

    def look(self, now_ns: int) -> None:
        """Compare with the detector's clock; where that stands still it tells nothing."""
        if now_ns == self._last_tick_ns:
            return
        if self._delays and now_ns < self._delays[-1][0]:
            self._delays.clear()  # that one was set back
        self.fresh, self._taken = self._taken, False
        step = 0 if self._last_tick_ns is None else max(now_ns - self._last_tick_ns, 0)
        self._last_tick_ns = now_ns
        self._silence_ns = 0 if self.fresh else self._silence_ns + step
        self.late_ns = self._silence_ns
        if self._newest_ns is None:
            return
        delay = now_ns - self._newest_ns
        if self.fresh:
            self._delays.append((now_ns, delay))
            while len(self._delays) > _LEAST and self._delays[1][0] <= now_ns - _WINDOW_NS:
                self._delays.popleft()
            self.offset_ns = min(known for _, known in self._delays)
        if self.offset_ns is not None:
            self.late_ns = max(delay - self.offset_ns, self._silence_ns)

    @property
    def settled(self) -> bool:
        """True where the offset was seen over the whole window."""
        if len(self._delays) < _LEAST:
            return False
        return self._delays[-1][0] - self._delays[0][0] >= _WINDOW_NS

    @property
    def believed(self) -> bool:
        """False where the channel's clock is too far away."""
        return self.offset_ns is None or abs(self.offset_ns) <= self.limit_ns
