"""What no estimator can do better after a kick, and what the delays are set against."""

from __future__ import annotations

import math
from functools import cache

from bounds import SignalModel, amplitude_window, sign_time_bound
from detection_rigs import BENCHES, RATE_HZ

from hunt_ros.dynamics.linear_stability import second_pair


@cache
def window(bench: str, speed: float, factor: float) -> float:
    """
    Shortest time, s, in which any estimator can know the amplitude after a kick to 5 %.

    Unknown are amplitude, phase, frequency, growth rate and a second mode of unknown phasor
    in each sensor; roughness and bias are known from before the kick.
    """
    rig = BENCHES[bench]
    amplitude = factor * rig.unstable(speed)
    second = next(x for x in second_pair(rig.rig) if x.imag >= 0.0) / rig.rig.time_scale
    settings = rig.settings(speed, 0.0)
    model = SignalModel(
        amplitude=amplitude,
        frequency_hz=rig.form.frequency_hz,
        growth_rate=float(rig.form.growth_rate(speed, amplitude)),
        lateral_noise=settings.lateral_sensor.noise,
        rate_hz=RATE_HZ,
        yaw_noise=settings.yaw_sensor.noise,
        yaw_ratio=complex(rig.mode(speed).yaw_per_lateral) / rig.rig.length_scale,
        known_background=True,
        second_mode=(second.imag / (2.0 * math.pi), -second.real),
    )
    return amplitude_window(model)


@cache
def sign_bound(bench: str, speed: float, factor: float) -> float:
    """Least time, s, to know at 3 sigma that a kick grows, by the closed form of the notes."""
    rig = BENCHES[bench]
    amplitude = factor * rig.unstable(speed)
    growth = float(rig.form.growth_rate(speed, amplitude))
    noise = rig.settings(speed, 0.0).lateral_sensor.noise
    return sign_time_bound(growth, amplitude, noise, 1.0 / RATE_HZ)


def cusum_bound(bench: str, speed: float, factor: float, hours: float) -> float:
    """
    Least mean delay, s, of any detector of the amplitude of a kick at a known phase.

    log(ARL) / I with I = A^2 / (4 sigma^2) nats a sample (Lorden 1971), one false alarm in so
    many hours of sensor noise; at least one sample.
    """
    rig = BENCHES[bench]
    noise = rig.settings(speed, 0.0).lateral_sensor.noise
    nats = (factor * rig.unstable(speed)) ** 2 / (4.0 * noise**2)
    return max(math.log(hours * 3600.0 * RATE_HZ) / nats, 1.0) / RATE_HZ
