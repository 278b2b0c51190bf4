"""The criteria and the forecast of v_c in a thread of their own: a refit delays no estimate."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from queue import SimpleQueue

from hunt_ros.criteria import Verdict
from hunt_ros.detection.companions import CompanionConfig, Companions
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.output import Motion, Output
from hunt_ros.forecast import Forecast
from hunt_ros.nodes.support.diagnostics import Diagnostics
from hunt_ros.nodes.support.parameters import read_wheelset
from hunt_ros.nodes.support.worker import Worker

#: What has come is worked on this often, s: seldom enough to cost little.
_ROUND_S = 0.1
_TASK = 'criteria and forecast'


class CompanionWorker:
    """
    Feeds `Companions` from a queue.

    Parameters
    ----------
    config : CompanionConfig
        What to run.
    detector : DetectorConfig
        What the detector is told of the rig.
    tell : callable
        Gets each `Verdict`, in the worker's thread.
    diagnostics : Diagnostics
        Told of an error: what runs beside the detector then begins anew.
    """

    def __init__(
        self,
        config: CompanionConfig,
        detector: DetectorConfig,
        tell: Callable[[Verdict], None],
        diagnostics: Diagnostics,
    ) -> None:
        rig = read_wheelset(config.forecast_rig) if config.forecast == 'wheelset' else None
        self._companions = Companions.of(config, detector, rig)
        self._tell = tell
        self._diagnostics = diagnostics
        self._queue: SimpleQueue[Motion | None] = SimpleQueue()
        self._worker: Worker | None = None
        if not self._companions.idle:
            self._worker = Worker(diagnostics.failed, _TASK, self._work)

    @property
    def forecast(self) -> Forecast | None:
        """The latest forecast; None where none is made."""
        return self._companions.forecast

    def offer(self, output: Output) -> None:
        """Hand over what the detector has given out; returns at once."""
        if self._worker is not None:
            for motion in output.motion:
                self._queue.put(motion)

    def reset(self) -> None:
        """Begin anew with the next samples."""
        if self._worker is not None:
            self._queue.put(None)

    def close(self) -> None:
        """Stop working."""
        if self._worker is not None:
            self._worker.stop()

    def _work(self, stopping: threading.Event) -> None:
        while not stopping.wait(_ROUND_S):
            motions: list[Motion] = []
            try:
                for _ in range(self._queue.qsize()):
                    if (motion := self._queue.get()) is not None:
                        motions.append(motion)
                        continue
                    self._take(motions)
                    motions = []
                    self._companions.reset()
                    self._diagnostics.done(_TASK)
                self._take(motions)
            except Exception as error:  # any: numbers of a rig that nobody has seen
                self._diagnostics.failed(_TASK, error)
                self._companions.reset()

    def _take(self, motions: Sequence[Motion]) -> None:
        if motions:
            for verdict in self._companions.take(Motion.joined(motions)):
                self._tell(verdict)
