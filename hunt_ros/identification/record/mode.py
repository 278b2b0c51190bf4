"""The mode shape of the recordings: what the yaw sensor makes of the lateral motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.dynamics.mode_table import fitted_shape
from hunt_ros.estimation.mode_measurement import measure_ratio
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import Record


def measured_shape(
    records: Sequence[Record], frequency_hz: float, settings: IdentificationSettings
) -> ModeShape | None:
    """
    Measure the mode shape wherever the recordings hold both sensors.

    Parameters
    ----------
    records : sequence of Record
        Those without `yaw` add nothing.
    frequency_hz : float
        Hunting frequency, Hz.
    settings : IdentificationSettings
        Says which lines are removed.

    Returns
    -------
    ModeShape or None
        None where no recording shows the motion on both sensors.
    """
    points = [measure_ratio(record, frequency_hz, settings.orders.tolist()) for record in records]
    if not points:
        return None
    return fitted_shape(
        np.concatenate([p.speed for p in points]),
        np.concatenate([p.amplitude for p in points]),
        np.concatenate([p.ratio for p in points]),
        np.concatenate([p.relative_std for p in points]),
        np.concatenate([p.frequency_hz for p in points]),
    )
