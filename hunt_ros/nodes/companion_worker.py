"""The criteria and the forecast of v_c in a thread of their own: a refit delays no estimate."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue

from hunt_ros.detection.companions import CompanionConfig, Companions
from hunt_ros.detection.criteria import Verdict
from hunt_ros.detection.forecast import Forecast
from hunt_ros.detection.output import Motion, Output
from hunt_ros.nodes.parameters import read_rig

#: What has come is worked on this often, s: seldom enough to cost little.
_ROUND_S = 0.1


class CompanionWorker:
    """
    Feeds `Companions` from a queue.

    Parameters
    ----------
    config : CompanionConfig
        What to run.
    channels : sequence of str
        What the detector has.
    tell : callable
        Gets each `Verdict`, in the worker's thread.
    """

    def __init__(
        self, config: CompanionConfig, channels: Sequence[str], tell: Callable[[Verdict], None]
    ) -> None:
        rig = read_rig(config.forecast_rig) if config.forecast == 'wheelset' else None
        self._companions = Companions.of(config, channels, rig)
        self._tell = tell
        self._queue: SimpleQueue[Motion | None] = SimpleQueue()
        self._stopped = threading.Event()
        if self._companions.idle:
            self._stopped.set()
        else:
            threading.Thread(target=self._work, name='companions', daemon=True).start()

    @property
    def forecast(self) -> Forecast | None:
        """The latest forecast; None where none is made."""
        return self._companions.forecast

    def offer(self, output: Output) -> None:
        """Hand over what the detector has given out; returns at once."""
        if not self._stopped.is_set():
            for motion in output.motion:
                self._queue.put(motion)

    def reset(self) -> None:
        """Begin anew with the next samples."""
        if not self._stopped.is_set():
            self._queue.put(None)

    def close(self) -> None:
        """Stop working."""
        self._stopped.set()

    def _work(self) -> None:
        while not self._stopped.wait(_ROUND_S):
            motions: list[Motion] = []
            while True:
                try:
                    motion = self._queue.get_nowait()
                except Empty:
                    break
                if motion is None:
                    self._take(motions)
                    motions.clear()
                    self._companions.reset()
                else:
                    motions.append(motion)
            self._take(motions)

    def _take(self, motions: Sequence[Motion]) -> None:
        if motions:
            for verdict in self._companions.take(Motion.joined(motions)):
                self._tell(verdict)
