"""Appendix A and beyond: what roughness, noise and sweep rate do to the measured loop."""

from __future__ import annotations

from hunt_ros.dynamics.escape import (
    AmplitudeDiffusion,
    committor,
    diffusion_from_quiet,
    mean_escape_time,
)

__all__ = [
    'AmplitudeDiffusion',
    'committor',
    'diffusion_from_quiet',
    'mean_escape_time',
]
