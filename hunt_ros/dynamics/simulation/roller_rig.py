"""
The rig in the time domain, as a stream of blocks.

The wheelset of Eqs. (2), (3) runs on rough rollers, under broadband forcing and
kicks, between flanges, driven by a motor and read by sensors.

Integration is classical Runge-Kutta at a fixed step of at most 0.052 / omega_psi
(2 ms on the paper's rig, one step a sample at 500 Hz): the fastest linear mode
then turns 0.045 rad a step, and after half a minute the motion is within 5 nm of an
adaptive integrator's. Slower sampling takes several steps a sample, and a stiff
flange shortens the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.covariance_root import covariance_root
from hunt_ros.dynamics.linear_stability import direction_response, quiet_covariance, settles
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.simulation import kernel
from hunt_ros.dynamics.simulation.settings import Roughness, SensorModel, SimulationSettings
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError
from hunt_ros.samples import NANOSECONDS

Array = NDArray[np.float64]

#: Longest step, in units of 1 / omega_psi.
LONGEST_STEP = 0.052
#: Longest step times the frequency of the wheelset on its flange: Runge-Kutta stays accurate.
LONGEST_FLANGE_STEP = 0.9
#: Largest damping times step (Runge-Kutta is stable to 2.78): sets the lowest rolling speed.
LARGEST_DAMPING_STEP = 1.7
#: Share of critical damping of a flange contact.
FLANGE_DAMPING_RATIO = 0.2
#: Beyond this yaw angle, rad, the nonlinear terms keep their value.
YAW_LIMIT = 0.1
#: Time over which roughness is brought up before the first sample, s.
SETTLING_S = 10.0
#: Increments in which that is done.
SETTLING_PARTS = 50


@dataclass(frozen=True, eq=False)
class SimulatedBlock:
    """
    Consecutive samples of the rig; all arrays have shape (n,).

    Parameters
    ----------
    stamps_ns : ndarray of int64
        True time of the samples since the start, ns.
    lateral, yaw : ndarray
        Readings, m and rad.
    speed, roller_angle : ndarray
        Measured speed, m/s, and continuous roller angle, rad.
    true_lateral : ndarray
        What the lateral sensor was looking at.
    """

    stamps_ns: NDArray[np.int64]
    lateral: Array
    yaw: Array
    speed: Array
    roller_angle: Array
    true_lateral: Array

    def __len__(self) -> int:
        return int(self.stamps_ns.size)


class RollerRig:
    """
    The rig as a stream: the same numbers in blocks of any size, to the bit.

    It starts settled: at `initial_speed` with its roughness brought up slowly,
    and a state drawn from the stationary distribution of the broadband forcing.
    At or above the critical speed nothing is settled: there it starts on the
    linear forced response alone.

    Parameters
    ----------
    rig : RigParameters
    settings : SimulationSettings
    seed : int
        Of everything random. Forcing and sensors have streams of their own: a
        noisier sensor does not change the motion.

    Attributes
    ----------
    target_speed : float
        Set point of the drive, m/s.
    """

    def __init__(
        self, rig: RigParameters, settings: SimulationSettings | None = None, seed: int = 0
    ) -> None:
        self.rig = rig
        self.settings = settings or SimulationSettings()
        self.seed = seed
        self._substeps, self._model = _pack_model(rig, self.settings)
        wheelset = Wheelset(rig)
        self._terms = np.hstack([wheelset.cubic, wheelset.quintic])
        self._harmonics = _pack_harmonics(rig, self.settings.roughness)
        self._period_ns = NANOSECONDS / self.settings.sample_rate_hz
        self.reset()

    def reset(self) -> None:
        """Go back to the start: what follows is what a new rig of this seed would give."""
        streams = np.random.SeedSequence(self.seed).spawn(4)
        self._forcing, self._noise, _, start = map(np.random.default_rng, streams)
        self._count = 0
        self.target_speed = self.settings.initial_speed
        self._state = self._settled(start)

    @property
    def speed(self) -> float:
        """True running speed, m/s."""
        return float(self._state[kernel.SPEED])

    @property
    def motion(self) -> tuple[float, float, float, float]:
        """True y (m), dy/dt (m/s), psi (rad), dpsi/dt (rad/s) of the next sample."""
        length, rate = self.rig.length_scale, 1.0 / self.rig.time_scale
        y, y_rate, psi, psi_rate = (float(x) for x in self._state[:4])
        return y * length, y_rate * length * rate, psi, psi_rate * rate

    def kick(
        self,
        lateral_m: float = 0.0,
        yaw_rad: float = 0.0,
        lateral_velocity: float = 0.0,
        yaw_rate: float = 0.0,
    ) -> None:
        """
        Hit the wheelset: add to its state (m, rad, m/s, rad/s) before the next sample.

        Raises
        ------
        ConfigError
            For a kick that is not finite.
        """
        values = (lateral_m, lateral_velocity, yaw_rad, yaw_rate)
        if not all(map(math.isfinite, values)):
            raise ConfigError(f'a kick must be finite, got {values}')
        length, rate = self.rig.length_scale, 1.0 / self.rig.time_scale
        scales = (length, length * rate, 1.0, rate)
        for place, (value, scale) in enumerate(zip(values, scales, strict=True)):
            self._state[place] += value / scale

    def advance(self, count: int, targets: Array | None = None) -> SimulatedBlock:
        """
        Simulate the next samples.

        Parameters
        ----------
        count : int
            Number of samples; 0 gives an empty block (and compiles the kernel).
        targets : ndarray, shape (count,), optional
            Set point for each sample, m/s; default: `target_speed` for all.

        Returns
        -------
        SimulatedBlock
            The first sample is the state as it is now, before anything moves.

        Raises
        ------
        ConfigError
            For a negative count, or set points that do not fit or are impossible.
        """
        if count < 0:
            raise ConfigError(f'cannot advance by {count} samples')
        if targets is None:
            targets = np.full(count, self.target_speed)
        if targets.shape != (count,) or not (targets >= 0.0).all() or np.isinf(targets).any():
            raise ConfigError(f'{count} samples need as many set points, finite and not negative')
        if count:
            self.target_speed = float(targets[-1])
        forcing = self._forcing.standard_normal((count, self._substeps))
        noise = self._noise.standard_normal((count, 3))
        out = np.empty((4, count))
        kernel.advance(
            self._state, targets, forcing, self._model, self._terms, self._harmonics, out
        )
        stamps = np.arange(self._count, self._count + count) * self._period_ns
        self._count += count
        speed, angle, lateral, yaw = out
        drive = self.settings.drive
        return SimulatedBlock(
            np.rint(stamps).astype(np.int64),
            _reading(lateral, noise[:, 0], self.settings.lateral_sensor),
            _reading(yaw, noise[:, 1], self.settings.yaw_sensor),
            drive.speed_gain * speed + drive.speed_noise * noise[:, 2],
            angle,
            lateral,
        )

    @property
    def _rolling(self) -> float:
        """Initial speed, m/s, as the creep forces have it: they do not end at standstill."""
        return max(self.settings.initial_speed, float(self._model[kernel.LOWEST_SPEED]))

    def _settled(self, start: np.random.Generator) -> Array:
        """State of the wheelset that has run at the initial speed for long."""
        state = np.zeros(6)
        state[kernel.SPEED] = self.settings.initial_speed
        speed = self._rolling
        matrix = Wheelset(self.rig).linear_matrix(speed)
        if settles(matrix):
            if len(self._harmonics):
                self._run_in(state)
            if self.settings.broadband > 0.0:
                covariance = quiet_covariance(self.rig, speed, self.settings.broadband)
                state[:4] += covariance_root(covariance) @ start.standard_normal(4)
        else:
            state[:4] += self._forced_state(0.0)
        return state

    def _forced_state(self, angle: float) -> Array:
        """Linear response to the roughness at the initial speed, at a roller angle."""
        total = np.zeros(4)
        for order, slope in self._harmonics:
            # the direction is slope * sin(order * angle)
            phasor = slope * np.exp(1j * (order * angle - math.pi / 2.0))
            response = direction_response(self.rig, self._rolling, order)
            total += (response * phasor).real
        return total

    def _run_in(self, state: Array) -> None:
        """
        Bring the roughness up slowly: a cold start could land beyond the unstable cycle.

        Each increment of the roughness comes with its linear response, so that only what
        the nonlinear response differs by is left to die out.
        """
        steps = math.ceil(SETTLING_S / self._model[kernel.STEP_S] / SETTLING_PARTS)
        angle_step = self._model[kernel.STEP_S] * self._model[kernel.ANGLE_PER_METRE]
        state[kernel.ANGLE] = -SETTLING_PARTS * steps * angle_step * state[kernel.SPEED]
        targets, harmonics = np.full(steps, state[kernel.SPEED]), self._harmonics.copy()
        forcing, out = np.zeros((steps, 1)), np.empty((4, steps))
        share = 0.0
        for part in range(SETTLING_PARTS):
            wanted = min(1.0, 1.25 * (part + 1) / SETTLING_PARTS)
            state[:4] += (wanted - share) * self._forced_state(float(state[kernel.ANGLE]))
            share = wanted
            harmonics[:, 1] = self._harmonics[:, 1] * share
            kernel.advance(state, targets, forcing, self._model, self._terms, harmonics, out)
        state[kernel.ANGLE] = 0.0  # reached to rounding


def _reading(true: Array, normal: Array, sensor: SensorModel) -> Array:
    """Return what a sensor reads."""
    reading = true + sensor.noise * normal
    if sensor.resolution > 0.0:
        reading = np.floor(reading / sensor.resolution + 0.5) * sensor.resolution
    return reading


def _pack_model(rig: RigParameters, settings: SimulationSettings) -> tuple[int, Array]:
    """Return the steps in a sample and the array `model` of the kernel."""
    rate = settings.sample_rate_hz
    flange = rig.flange_stiffness_n_per_m / rig.mass_kg * rig.time_scale**2
    longest = min(LONGEST_STEP, LONGEST_FLANGE_STEP / math.sqrt(flange))
    substeps = math.ceil(1.0 / (rate * rig.time_scale * longest) - 1e-9)
    step_s = 1.0 / (rate * substeps)
    step = step_s / rig.time_scale
    drive = settings.drive
    lag = 1.0 - math.exp(-step_s / drive.time_constant_s) if drive.time_constant_s else 1.0
    model = np.zeros(17)
    model[kernel.STEP] = step
    model[kernel.D11] = rig.d11 * rig.speed_scale
    model[kernel.D22] = rig.d22 * rig.speed_scale
    model[kernel.LATERAL_CREEP] = rig.d11
    model[kernel.K11] = rig.k11
    model[kernel.K21] = rig.k21
    model[kernel.CLEARANCE] = rig.flange_clearance_m / rig.length_scale
    model[kernel.FLANGE_STIFFNESS] = flange
    model[kernel.FLANGE_DAMPING] = 2.0 * FLANGE_DAMPING_RATIO * math.sqrt(flange)
    # Creep damping grows as 1 / v. Below this speed (0.1 m/s on the paper's rig) the
    # wheelset is taken to roll at it, which keeps a standing rig stuck and stable.
    damping = max(rig.d11, rig.d22) * rig.speed_scale
    model[kernel.LOWEST_SPEED] = damping * step / LARGEST_DAMPING_STEP
    model[kernel.LAG] = lag
    model[kernel.MOST_CHANGE] = drive.acceleration_limit * step_s
    model[kernel.STEP_S] = step_s
    model[kernel.ANGLE_PER_METRE] = 2.0 / rig.roller_diameter_m
    model[kernel.LENGTH] = rig.length_scale
    model[kernel.FORCING] = settings.broadband / math.sqrt(step)
    model[kernel.YAW_LIMIT] = YAW_LIMIT
    return substeps, model


def _pack_harmonics(rig: RigParameters, roughness: Roughness) -> Array:
    """Rows of order and slope amplitude that make the lines asked for."""
    wheel_ratio = rig.roller_diameter_m / (2.0 * rig.wheel_radius_m)
    lines = [(k + 1.0, a) for k, a in enumerate(roughness.amplitudes)]
    lines += [((k + 1.0) * wheel_ratio, a) for k, a in enumerate(roughness.wheel_amplitudes)]
    rows = []
    for order, amplitude in lines:
        if amplitude > 0.0:
            response = direction_response(rig, roughness.reference_speed, order)[0]
            slope = amplitude / rig.length_scale / abs(response)
            rows.append((order, slope))
    return np.array(rows, dtype=np.float64).reshape(-1, 2)
