"""The criteria and the forecast of v_c in a thread of their own: a refit delays no estimate."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from queue import Empty, SimpleQueue

import numpy as np

from hunt_ros.detection.companions import Companions
from hunt_ros.detection.criteria import CRITERIA, CriteriaPanel, Verdict
from hunt_ros.detection.forecast import CriticalSpeedForecast, Forecast
from hunt_ros.errors import ConfigError
from hunt_ros.nodes.parameters import read_rig
from hunt_ros.settings import Settings, setting


@dataclass(frozen=True)
class CompanionConfig(Settings):
    """Parameters of what runs beside the detector."""

    criteria: tuple[str, ...] = setting(
        ('',), f'railway criteria to run as well: {", ".join(CRITERIA)}', fixed=True
    )
    criteria_scale: float = setting(1.0, 'their limits times this', low=1e-4, high=1e4, fixed=True)
    criteria_rate_hz: float = setting(
        200.0, 'rate at which they work', unit='Hz', low=50.0, high=2000.0, fixed=True
    )
    forecast: str = setting(
        'smooth',
        'damping law of the forecast of v_c from the quiet response',
        choices=('off', 'smooth', 'wheelset'),
        fixed=True,
    )
    forecast_rig: str = setting(
        '', "YAML file of the rig for the law 'wheelset'; empty: the built-in rig", fixed=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.criteria:
            if name and name not in CRITERIA:
                raise ConfigError(f'criteria: unknown {name!r}, expected some of {list(CRITERIA)}')


class CompanionWorker:
    """
    Feeds `Companions` from a queue.

    Parameters
    ----------
    config : CompanionConfig
        What to run.
    roller : bool
        Whether the rig has a roller angle.
    tell : callable
        Gets each `Verdict`, in the worker's thread.
    """

    def __init__(
        self, config: CompanionConfig, roller: bool, tell: Callable[[Verdict], None]
    ) -> None:
        names = [name for name in config.criteria if name]
        scales = {name: {'scale': config.criteria_scale} for name in names}
        panel = CriteriaPanel(names, config.criteria_rate_hz, scales) if names else None
        rig = read_rig(config.forecast_rig) if config.forecast == 'wheelset' else None
        forecast = None if config.forecast == 'off' else CriticalSpeedForecast(rig=rig)
        self._companions = Companions(panel, forecast, roller)
        self._tell = tell
        self._queue: SimpleQueue[tuple[str, np.ndarray, np.ndarray, bool] | None] = SimpleQueue()
        self._running = panel is not None or forecast is not None
        if self._running:
            threading.Thread(target=self._work, name='companions', daemon=True).start()

    @property
    def forecast(self) -> Forecast | None:
        """The latest forecast; None where none is made."""
        return self._companions.forecast

    def offer(self, channel: str, stamps: np.ndarray, values: np.ndarray, quiet: bool) -> None:
        """Hand samples over; returns at once."""
        if self._running:
            self._queue.put((channel, stamps, values, quiet))

    def reset(self) -> None:
        """Begin anew with the next samples."""
        if self._running:
            self._queue.put(None)

    def close(self) -> None:
        """Stop working."""
        self._running = False

    def _work(self) -> None:
        while self._running:
            try:
                order = self._queue.get(timeout=0.2)
            except Empty:
                continue
            if order is None:
                self._companions.reset()
                continue
            for verdict in self._companions.update(*order):
                self._tell(verdict)
