"""
From a rig and its settings to the arrays of the simulation's inner loop.

Also the choice of the integration step and of the lowest rolling speed, which both follow
from the stiffest thing in the model.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hunt_ros.dynamics.forced_response import direction_response
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.dynamics.simulation import kernel
from hunt_ros.dynamics.simulation.settings import Roughness, SimulationSettings

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


def pack_model(rig: RigParameters, settings: SimulationSettings) -> tuple[int, Array]:
    """Return the steps in a sample and the array `model` of the kernel."""
    rate = settings.sample_rate_hz
    flange = rig.flange_stiffness_n_per_m / rig.mass_kg * rig.time_scale**2
    longest = min(LONGEST_STEP, LONGEST_FLANGE_STEP / math.sqrt(flange))
    substeps = math.ceil(1.0 / (rate * rig.time_scale * longest) - 1e-9)
    step_s = 1.0 / (rate * substeps)
    step = step_s / rig.time_scale
    drive = settings.drive
    lag = 1.0 - math.exp(-step_s / drive.time_constant_s) if drive.time_constant_s else 1.0
    model = np.zeros(19)
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
    model[kernel.SPEED_GAIN] = drive.speed_gain
    model[kernel.SPEED_NOISE] = drive.speed_noise
    return substeps, model


def pack_harmonics(rig: RigParameters, roughness: Roughness) -> Array:
    """Rows of order, slope amplitude and phase that make the lines asked for."""
    wheel_ratio = rig.roller_diameter_m / (2.0 * rig.wheel_radius_m)
    lines = [(k + 1.0, a) for k, a in enumerate(roughness.amplitudes)]
    lines += [((k + 1.0) * wheel_ratio, a) for k, a in enumerate(roughness.wheel_amplitudes)]
    phases = dict(enumerate(roughness.phases))
    rows = []
    for place, (order, amplitude) in enumerate(lines):
        if amplitude > 0.0:
            response = direction_response(rig, roughness.reference_speed, order)[0]
            slope = amplitude / rig.length_scale / abs(response)
            rows.append((order, slope, phases.get(place, 0.0)))
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def pack_sensors(settings: SimulationSettings) -> Array:
    """Return the array `sensors` of the kernel: rows lateral and yaw."""
    rate = settings.sample_rate_hz
    rows = [
        (
            sensor.gain,
            sensor.offset,
            sensor.noise,
            sensor.resolution,
            sensor.full_scale,
            sensor.dropouts_per_s / rate,
            max(1.0, round(sensor.dropout_s * rate)),
        )
        for sensor in (settings.lateral_sensor, settings.yaw_sensor)
    ]
    return np.array(rows)
