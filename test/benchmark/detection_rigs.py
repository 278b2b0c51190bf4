"""The rigs of the benchmark of the detector: branches, noise, and what becomes of a motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from bench_forecast import other_rig
from cycles_made import at_speed
from fitted_form import fitted_form
from mode_shapes import shape_of

from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.limit_cycle import Branch, limit_cycles
from hunt_ros.dynamics.linear_stability import Mode, critical_speed, hunting_mode
from hunt_ros.dynamics.mode_shape import ModeShape
from hunt_ros.dynamics.normal_form import NormalForm
from hunt_ros.dynamics.parameters import RigParameters, paper_rig
from hunt_ros.dynamics.simulation import RollerRig
from hunt_ros.dynamics.simulation.settings import Roughness, SensorModel, SimulationSettings

RATE_HZ = 500.0

#: What of the state a kick adds to.
WAYS = ('y', 'dy/dt', 'psi', 'dpsi/dt')


@dataclass(frozen=True, eq=False)
class Bench:
    """
    A rig on the bench: its branches, its noise, the speeds it is tried at.

    Speeds are in m/s; `kick_speeds` lie between v_n and v_c, `cycle_speeds` above v_n.
    Roughness sizes and sensor noise are those of the paper's rig times `scale`.
    """

    key: str
    rig: RigParameters
    kick_speeds: tuple[float, ...]
    quiet_speeds: tuple[float, ...]
    cycle_speeds: tuple[float, ...] = ()
    scale: float = 1.0

    @cached_property
    def v_c(self) -> float:
        return critical_speed(self.rig)

    @cached_property
    def branch(self) -> Branch:
        """Limit cycles of the full model."""
        return limit_cycles(self.rig)

    @cached_property
    def form(self) -> NormalForm:
        """The quintic form that fits the full model's limit cycles best: the true form."""
        within = (0.825 * self.v_c, 1.05 * self.v_c)
        return fitted_form(normal_form_of(self.rig), self.branch, within)

    @cached_property
    def shape(self) -> ModeShape:
        """Mode shape from the equations of motion."""
        return shape_of(self.rig, self.branch)

    @cached_property
    def cycle(self) -> float:
        """Amplitude of the limit cycle at 1.05 v_c, m: the size of hunting on this rig."""
        return self.stable(1.05 * self.v_c)

    def mode(self, speed: float) -> Mode:
        return hunting_mode(self.rig, speed)

    def unstable(self, speed: float) -> float:
        """A_u of the full model, m; NaN where there is none."""
        at = at_speed(self.branch, speed)
        return float(at.amplitude[~at.stable][0]) if (~at.stable).any() else math.nan

    def stable(self, speed: float) -> float:
        """Amplitude of the limit cycle of the full model, m; NaN where there is none."""
        at = at_speed(self.branch, speed)
        return float(at.amplitude[at.stable][0]) if at.stable.any() else math.nan

    def broadband(self, speed: float, ratio: float) -> float:
        """Strength of the forcing that gives A_rms = ratio A_u in the quiet state."""
        mode, rig = self.mode(speed), self.rig
        # D = |l4|^2 d0^2 / time scale for a forcing of 1, and A_rms^2 = 2 D / damping.
        unit = abs(mode.adjoint[3]) * rig.length_scale
        unit *= math.sqrt(2.0 / (rig.time_scale * -mode.growth_rate))
        return ratio * self.unstable(speed) / unit

    def settings(
        self, speed: float, broadband: float, roughness: float = 0.0, noise: float = 5e-6
    ) -> SimulationSettings:
        """Two sensors with noise in y and psi; roughness and noise as on the paper's rig, m."""
        line = self.scale * roughness
        return SimulationSettings(
            sample_rate_hz=RATE_HZ,
            initial_speed=speed,
            broadband=broadband,
            roughness=Roughness((line, 0.4 * line)) if line else Roughness(),
            lateral_sensor=SensorModel(noise=self.scale * noise),
            yaw_sensor=SensorModel(noise=4.0 * noise),
        )

    def kick(self, roller: RollerRig, way: str, size: float) -> None:
        """Hit it: `size` is the lateral amplitude, m, of the same size in (y, psi) and rates."""
        place = WAYS.index(way)
        mode = self.mode(self.v_c)
        values = np.zeros(4)
        values[place] = size
        if place >= 2:
            values[place] *= abs(mode.shape[2]) / self.rig.length_scale
        if place % 2:
            values[place] *= 2.0 * math.pi * mode.frequency_hz
        y, y_rate, psi, psi_rate = (float(value) for value in values)
        roller.kick(y, psi, y_rate, psi_rate)

    def escapes(self, roller: RollerRig, speed: float, patience_s: float = 120.0) -> bool:
        """Follow the motion itself until it hunts (True) or is quiet."""
        edge = self.unstable(speed)
        top = 0.5 * (edge + self.stable(speed))
        size = 0.0
        for _ in range(int(patience_s)):
            block = roller.advance(int(RATE_HZ))
            size = 0.5 * float(np.ptp(block.true_lateral))
            if size > top:
                return True
            if size < 0.45 * edge:
                return False
        return size > edge


BENCHES = {
    bench.key: bench
    for bench in (
        Bench('paper', paper_rig(), (6.6, 7.2, 7.6), (6.0, 7.2, 7.6), (6.6, 7.2, 8.0, 8.8)),
        Bench(
            'supercritical',
            replace(paper_rig(), name='supercritical', beta={'30': -446.87, '50': -2.74748e6}),
            (),
            (6.0, 7.2, 7.6),
        ),
        Bench(
            '14 m/s',
            # Other creep, conicity, frequency and size.
            other_rig(),
            (12.6, 13.0, 13.3),
            (11.0, 12.6, 13.3),
            (12.6, 13.3, 14.0, 15.4),
            scale=other_rig().half_gauge_m / paper_rig().half_gauge_m,
        ),
    )
}
