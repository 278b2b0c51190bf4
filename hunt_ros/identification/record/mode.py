"""The mode shape of the recordings: what the yaw sensor makes of the lateral motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.dynamics.mode_table import fitted_shape
from hunt_ros.estimation.mode_measurement import RatioPoints


def measured_shape(points: Sequence[RatioPoints]) -> ModeShape | None:
    """
    Put together what the recordings show of the mode shape.

    Parameters
    ----------
    points : sequence of RatioPoints
        Of each recording; those without `yaw` add nothing.

    Returns
    -------
    ModeShape or None
        None where no recording shows the motion on both sensors.
    """
    if not points:
        return None
    return fitted_shape(
        np.concatenate([p.speed for p in points]),
        np.concatenate([p.amplitude for p in points]),
        np.concatenate([p.ratio for p in points]),
        np.concatenate([p.relative_std for p in points]),
        np.concatenate([p.frequency_hz for p in points]),
    )
