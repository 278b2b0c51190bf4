"""The simulated rig: settled start, finite kicks, sensors, drive; streams: the contract."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made import BUSY
from scipy.integrate import solve_ivp

from hunt_ros.dynamics.linear_stability import critical_speed, quiet_covariance
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Hold, Profile, Sweep
from hunt_ros.dynamics.simulation import (
    DriveModel,
    Kick,
    RollerRig,
    Roughness,
    SensorModel,
    SimulationSettings,
    experiment,
    simulate,
)
from hunt_ros.dynamics.wheelset import Wheelset
from hunt_ros.errors import ConfigError


def test_a_record_is_the_stream_with_its_kicks_and_profile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(experiment, 'BLOCK', 333)
    profile = Profile((Sweep(6.5, 7.5, 0.5, back=False),))
    record = simulate(paper_rig(), BUSY, profile, kicks=[Kick(1.0011, lateral_m=2e-4)], seed=7)
    stream = RollerRig(paper_rig(), replace(BUSY, initial_speed=6.5), 7)
    count = 1001
    targets = np.interp(np.arange(count) / 500, *profile.corners())
    parts = [stream.advance(501, targets[:501])]
    stream.kick(2e-4)
    parts.append(stream.advance(count - 501, targets[501:]))
    whole = experiment.record_of(parts, BUSY, '')
    for name, series in record.items():
        np.testing.assert_array_equal(series.values, whole[name].values)
        np.testing.assert_array_equal(series.stamps_ns, whole[name].stamps_ns)
    assert record['speed'].rate_hz == pytest.approx(100)
    assert record.duration_s == pytest.approx(2.0, rel=1e-4)


@pytest.mark.parametrize('rate', [100.0, 333.0, 500.0, 2000.0])
def test_free_motion_is_that_of_an_adaptive_integrator(rate: float) -> None:
    rig = RollerRig(paper_rig(), SimulationSettings(rate, initial_speed=7.2))
    rig.kick(3e-4, 1e-3, 2e-3, -1e-2)
    y0, v0, p0, w0 = rig.motion
    block = rig.advance(int(3 * rate))
    parameters, wheelset = paper_rig(), Wheelset(paper_rig())
    length, scale = parameters.length_scale, parameters.time_scale
    times = np.arange(int(3 * rate)) / rate
    run = solve_ivp(
        lambda t, x: wheelset.derivative(x, 7.2),
        (0, times[-1] / scale),
        [y0 / length, v0 * scale / length, p0, w0 * scale],
        method='DOP853',
        t_eval=times / scale,
        rtol=1e-11,
        atol=1e-14,
    )
    np.testing.assert_allclose(block.true_lateral, run.y[0] * length, atol=1e-9)
    np.testing.assert_allclose(block.yaw, run.y[2], atol=1e-8)


@pytest.mark.parametrize(
    'kick',
    [(1e-2, 0, 0, 0), (0, 0.5, 0, 0), (0, 0, 10.0, 0), (1e3, 1.0, 1e3, 1e5), (-1, 0, 1e6, 1e6)],
)
@pytest.mark.parametrize('speed', [0.3, 7.2, 8.8, 25.0])
def test_any_kick_stays_finite_and_ends_in_an_ordinary_state(
    kick: tuple[float, float, float, float], speed: float
) -> None:
    rig = RollerRig(paper_rig(), SimulationSettings(initial_speed=speed))
    rig.kick(*kick)
    block = rig.advance(15_000)
    assert np.isfinite(block.true_lateral).all()
    end = np.abs(block.true_lateral[-1000:]).max()
    assert end < 1.4 * paper_rig().flange_clearance_m


@pytest.mark.parametrize('speed', [6.4, 7.2, 7.6])
def test_the_roughness_line_has_the_amplitude_asked_for_from_the_first_sample(
    speed: float,
) -> None:
    wanted = 30e-6
    rough = Roughness((wanted,), reference_speed=speed)
    stream = RollerRig(paper_rig(), SimulationSettings(initial_speed=speed, roughness=rough))
    block = stream.advance(1500)
    wave = np.exp(-1j * block.roller_angle)
    for part in (slice(0, 500), slice(1000, 1500)):
        design = np.stack([wave[part].real, wave[part].imag], axis=1)
        fit, *_ = np.linalg.lstsq(design, block.true_lateral[part], rcond=None)
        assert np.hypot(*fit) == pytest.approx(wanted, rel=0.02)
        rest = block.true_lateral[part] - design @ fit
        assert np.abs(rest).max() < 0.03 * wanted  # nothing rings: the start is settled


def test_roughness_lines_follow_the_roller_and_the_wheel() -> None:
    rig = paper_rig()
    rough = Roughness((20e-6, 10e-6), wheel_amplitudes=(5e-6,), reference_speed=6.0)
    stream = RollerRig(rig, SimulationSettings(initial_speed=6.0, roughness=rough))
    block = stream.advance(20_000)
    for order, wanted in ((1, 20e-6), (2, 10e-6), (0.15 / 0.036, 5e-6)):
        phasor = 2 * np.mean(block.true_lateral * np.exp(-1j * order * block.roller_angle))
        assert abs(phasor) == pytest.approx(wanted, rel=0.03), order
    # Eq. (1): a turn takes pi D / v
    turns = block.roller_angle[-1] / (2 * np.pi)
    seconds = block.stamps_ns[-1] * 1e-9
    assert turns / seconds == pytest.approx(6.0 / (np.pi * 0.3), rel=1e-9)


def test_broadband_motion_has_the_stationary_covariance_at_start_and_later() -> None:
    rig, wn = paper_rig(), 1e-5
    wanted = np.sqrt(np.diag(quiet_covariance(rig, 7.2, wn)))
    quiet = SimulationSettings(initial_speed=7.2, broadband=wn)
    starts, ends = [], []
    for seed in range(400):
        stream = RollerRig(rig, quiet, seed)
        block = stream.advance(1001)
        starts.append((block.true_lateral[0], block.yaw[0]))
        ends.append((block.true_lateral[-1], block.yaw[-1]))
    for sample in (starts, ends):
        std = np.std(sample, axis=0) / [rig.length_scale, 1.0]
        # 400 draws: the standard deviation is known to 3.5 %
        np.testing.assert_allclose(std, wanted[[0, 2]], rtol=0.12)


def test_no_stationary_state_is_claimed_from_the_critical_speed_on() -> None:
    with pytest.raises(ConfigError, match=r'no stationary state at 8\.1 m/s'):
        quiet_covariance(paper_rig(), 8.1, 1e-5)
    rig = paper_rig()
    v_c = critical_speed(rig)
    for speed in (v_c, np.nextafter(v_c, 0.0), np.nextafter(v_c, 9.0), v_c * (1.0 - 1e-12)):
        with pytest.raises(ConfigError, match='no stationary state'):
            quiet_covariance(rig, float(speed), 1e-5)
        # By rounding the forcing once had it start kilometres from the centre.
        settings = SimulationSettings(initial_speed=float(speed), broadband=1e-5)
        assert abs(RollerRig(rig, settings, seed=0).advance(2).true_lateral).max() < 1e-4


def test_readings_have_the_steps_of_the_converter() -> None:
    sensor = SensorModel(resolution=1e-5)
    stream = RollerRig(paper_rig(), SimulationSettings(initial_speed=8.8, lateral_sensor=sensor))
    stream.kick(6e-4)
    block = stream.advance(3000)
    expected = np.floor(block.true_lateral / 1e-5 + 0.5) * 1e-5
    np.testing.assert_allclose(block.lateral, expected, atol=1e-18)


def test_the_drive_obeys_its_limit_and_its_lag() -> None:
    drive = DriveModel(time_constant_s=0.5, acceleration_limit=0.8)
    stream = RollerRig(paper_rig(), SimulationSettings(initial_speed=6.0, drive=drive))
    stream.target_speed = 8.0
    speed = stream.advance(5000).speed
    slope = np.diff(speed) * 500
    assert slope.max() == pytest.approx(0.8, rel=1e-9)
    near = (8.0 - speed > 1e-3) & (8.0 - speed < 0.3)
    decay = np.diff(np.log(8.0 - speed[near])) * 500
    np.testing.assert_allclose(decay, -2.0, rtol=1e-6)
    stream.target_speed = 0.0
    standing = stream.advance(10_000)
    assert standing.speed[-1] < 1e-3
    assert np.isfinite(standing.true_lateral).all()


@pytest.mark.parametrize(
    ('make', 'message'),
    [
        (lambda: SimulationSettings(sample_rate_hz=0.0), 'sample_rate_hz: 0.0 is below 0.001 Hz'),
        (lambda: SimulationSettings(broadband=-1.0), 'broadband: -1.0 is below 0'),
        (lambda: SensorModel(noise=float('nan')), 'noise: nan is not a number'),
        (lambda: Roughness((-1e-6,)), 'amplitudes must not be negative'),
        (lambda: DriveModel(acceleration_limit=0.0), 'acceleration_limit: 0.0 is below 1e-06'),
        (lambda: RollerRig(paper_rig()).advance(-1), 'cannot advance by -1'),
        (lambda: RollerRig(paper_rig()).advance(2, np.array([7.0, np.nan])), 'as many set points'),
        (lambda: RollerRig(paper_rig()).advance(2, np.array([7.0])), 'as many set points'),
        (lambda: RollerRig(paper_rig()).kick(float('inf')), 'a kick must be finite'),
        (
            lambda: simulate(paper_rig(), SimulationSettings(), Profile((Hold(7.0, 0.0),))),
            'duration must be positive',
        ),
    ],
)
def test_impossible_values_are_named(make: object, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make()  # type: ignore[operator]


@pytest.mark.parametrize('target', [-1.0, float('nan'), float('inf')])
def test_a_set_point_that_cannot_be_moves_nothing(target: float) -> None:
    stream = RollerRig(paper_rig())
    stream.target_speed = target
    with pytest.raises(ConfigError, match='finite and not negative'):
        stream.advance(1)


@pytest.mark.parametrize('targets', [[7.0, -1.0], [7.0, float('inf')], [6.5]])
def test_a_set_point_that_is_refused_is_not_kept(targets: list[float]) -> None:
    stream, other = (RollerRig(paper_rig(), seed=3) for _ in range(2))
    with pytest.raises(ConfigError, match='finite and not negative'):
        stream.advance(2, np.array(targets))
    assert stream.target_speed == other.target_speed
    np.testing.assert_array_equal(stream.advance(50).lateral, other.advance(50).lateral)


def test_profiles_are_what_they_say() -> None:
    stairs = Profile(tuple(Hold(float(v), 10.0, 0.5) for v in (6.0, 7.0, 6.5)))
    at = [0, 10, 11, 12, 22, 22.5, 23, 33]
    np.testing.assert_allclose(np.interp(at, *stairs.corners()), [6, 6, 6.5, 7, 7, 6.75, 6.5, 6.5])
    assert stairs.duration_s == pytest.approx(33.0)
    sweep = Profile((Sweep(6.0, 9.0, 0.02),))
    assert sweep.duration_s == pytest.approx(300.0)
    at = [0, 75, 150, 300, 400]
    np.testing.assert_allclose(np.interp(at, *sweep.corners()), [6, 7.5, 9, 6, 6])


def test_a_roller_that_stands_still_starts_and_stops() -> None:
    settings = SimulationSettings(initial_speed=0.0, broadband=8e-6, roughness=Roughness((2e-5,)))
    profile = Profile((Corners((0.0, 5.0, 15.0, 25.0, 35.0), (0.0, 0.0, 5.0, 5.0, 0.0)),))
    record = simulate(paper_rig(), settings, profile, seed=1)
    speed, angle = record['speed'].values, record['roller'].values
    assert speed[0] == 0.0
    assert angle[450] == angle[0]
    assert speed.max() == pytest.approx(5.0, abs=1e-3)
    assert speed[-1] < 0.4
    assert np.isfinite(record['lateral'].values).all()
    assert np.abs(record['lateral'].values).max() < 1e-3
