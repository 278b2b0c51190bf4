"""Recordings of the simulated rig, made once."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from fitted_form import fitted_form
from made import held, rig_settings
from mode_shapes import shape_of

from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.limit_cycle import limit_cycles
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Profile
from hunt_ros.dynamics.simulation import Kick, simulate
from hunt_ros.samples import Record

sys.path.insert(0, str(Path(__file__).parent))  # for what several tests share
Recorder = Callable[..., Record]


@cache
def _recorded(
    profile: Profile,
    duration_s: float,
    kicks: tuple[Kick, ...],
    seed: int,
    broadband: float,
    roughness: tuple[float, ...],
) -> Record:
    settings = rig_settings(500.0, broadband, roughness)
    return simulate(paper_rig(), settings, profile, duration_s, kicks, seed)


@pytest.fixture(scope='session')
def recorded() -> Recorder:
    """recorded(speed or profile, duration, kicks=[(time, lateral_m)]) -> Record."""

    def make(
        speed: float | Profile,
        duration_s: float,
        kicks: Sequence[tuple[float, float]] = (),
        seed: int = 1,
        broadband: float = 8e-6,
        roughness: tuple[float, ...] = (50e-6, 20e-6),
    ) -> Record:
        profile = speed if isinstance(speed, Profile) else held(speed)
        blows = tuple(Kick(time, lateral_m=size) for time, size in kicks)
        return _recorded(profile, duration_s, blows, seed, broadband, roughness)

    return make


@pytest.fixture(scope='session')
def true_form() -> IdentifiedNormalForm:
    """The form of the simulated rig, fitted to its limit cycles, with a small uncertainty."""
    theory = normal_form_of(paper_rig())
    branch = limit_cycles(paper_rig())
    form = fitted_form(theory, branch, (6.6, 8.4))
    spread = np.array([0.02, 0.002, 0.01, 0.05, 0.05, 0.01])
    scale = np.array([1.0, form.D1, form.D4, form.D7, form.D10, form.D15])
    return IdentifiedNormalForm(form, np.diag((0.02 * spread * scale) ** 2))


@pytest.fixture(scope='session')
def shaped(true_form) -> IdentifiedNormalForm:
    """The same with the mode shape of the rig."""
    return replace(true_form, mode_shape=shape_of(paper_rig(), limit_cycles(paper_rig())))
