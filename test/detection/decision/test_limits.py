"""Limits in mm, mrad and m/s2, and channels that may be missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fed import Moving
from made import SECOND

from hunt_ros.detection import DetectorConfig, Level, State
from hunt_ros.errors import ConfigError


class Rig(Moving):
    """Moves sideways by amplitudes given per second; no form, a speed of 7.2 m/s."""

    def __init__(self, channels: tuple[str, ...] = ('lateral', 'speed'), **settings) -> None:
        speeds = {'critical_speed_mps': 8.0, 'nonlinear_critical_speed_mps': 8.0}
        super().__init__(None, channels=channels, **speeds, **settings)

    def hold(self, *amplitudes_m: float, **more: float) -> None:
        """Go on for a second with each amplitude."""
        self.move(np.repeat(amplitudes_m, 200), **more)

    def tick(self) -> None:
        self.outputs.append(self.detector.tick(round(self.seconds * SECOND)))

    @property
    def events(self) -> list:
        return list(self.output.events)

    def said(self) -> list[tuple[str, str]]:
        """Return word and test of the events about limits."""
        return [
            (e.event, e.test)
            for e in self.events
            if e.event in ('limit_exceeded', 'limit_cleared')
        ]


def test_a_limit_is_its_own_cause_with_hysteresis_and_an_alarm_that_latches() -> None:
    rig = Rig(warn_lateral_mm=1.0, alarm_lateral_mm=2.0)
    rig.hold(*[20e-6] * 4)
    assert not rig.said()
    rig.hold(*[1.5e-3] * 2)
    warned = [event for event in rig.events if event.event == 'limit_exceeded']
    assert [event.test for event in warned] == ['warn_lateral_mm']
    assert 'warn limit of 1 mm' in warned[0].cause
    assert 4 * SECOND < warned[0].since_ns < warned[0].stamp_ns < 5 * SECOND
    rig.hold(*[2.5e-3] * 2)
    status = rig.detector.status
    assert (status.level, status.alarm) == (Level.ERROR, True)
    (over,) = (event for event in rig.events if event.test == 'alarm_lateral_mm')
    assert over.level is Level.ERROR
    assert 'is above the alarm limit of 2 mm' in over.cause
    assert any(
        reason.startswith('lateral amplitude above its alarm limit') for reason in status.reasons
    )
    count = len(rig.said())
    rig.hold(*[1.9e-3, 2.1e-3] * 4)  # about the limit: nothing changes
    assert len(rig.said()) == count
    rig.hold(*[20e-6] * 6)
    assert sorted(rig.said()[count:]) == [
        ('limit_cleared', 'alarm_lateral_mm'),
        ('limit_cleared', 'warn_lateral_mm'),
    ]
    assert rig.detector.status.alarm, 'until it is acknowledged'
    (first, *_) = rig.detector.history.alarms
    assert rig.detector.history.highest['highest_amplitude_m'] == pytest.approx(2.5e-3, rel=0.1)
    assert first.began_ns > 0
    rig.assert_replayed()


@pytest.mark.parametrize(
    ('setting', 'value'),
    [('alarm_yaw_mrad', 1.0), ('alarm_acceleration_mps2', 0.15), ('alarm_lateral_mm', 0.4)],
)
def test_each_quantity_has_a_limit_in_its_unit(setting: str, value: float) -> None:
    rig = Rig(('lateral', 'yaw', 'speed'), **{setting: value})
    # 0.5 mm at 2.84 Hz: 1.25 mrad, 0.159 m/s2.
    rig.hold(*[0.45e-3 if setting != 'alarm_lateral_mm' else 0.35e-3] * 3, yaw=2.5)
    rig.tick()
    if setting != 'alarm_yaw_mrad':
        assert not rig.said()
    rig.hold(*[0.5e-3] * 3, yaw=2.5)
    assert ('limit_exceeded', setting) in rig.said()
    assert f'{value:g}' in next(e.cause for e in rig.events if e.test == setting)


def test_limits_change_while_it_runs_and_are_replayed_bit_for_bit() -> None:
    rig = Rig(alarm_lateral_mm=5.0)
    rig.hold(*[1.5e-3] * 3)
    assert not rig.said()
    rig.outputs.append(
        rig.detector.reconfigure(replace(rig.detector.config, alarm_lateral_mm=1.0))
    )
    rig.hold(*[1.5e-3] * 2)
    assert rig.said() == [('limit_exceeded', 'alarm_lateral_mm')]
    rig.outputs.append(rig.detector.acknowledge(5 * SECOND, 'Mia'))
    assert rig.detector.status.alarm, 'the limit is still exceeded'
    rig.outputs.append(
        rig.detector.reconfigure(replace(rig.detector.config, alarm_lateral_mm=0.0))
    )
    rig.hold(*[1.5e-3] * 2)
    assert rig.said()[-1] == ('limit_cleared', 'alarm_lateral_mm')
    assert 'is off' in rig.events[[e.event for e in rig.events].index('limit_cleared')].cause
    rig.assert_replayed()


@pytest.mark.parametrize(
    ('settings', 'word'),
    [
        ({'warn_yaw_mrad': 3.0, 'alarm_yaw_mrad': 2.0}, 'warn_yaw_mrad'),
        ({'optional_channels': ('pitch',)}, 'pitch'),
        ({'optional_channels': ('lateral', 'yaw')}, 'lateral or yaw'),
        ({'optional_channels': ('speed',)}, 'constant_speed_mps'),
    ],
)
def test_limits_and_optional_channels_that_cannot_be_are_named(settings, word) -> None:
    with pytest.raises(ConfigError, match=word):
        DetectorConfig(**settings)


def test_an_optional_channel_that_is_absent_is_no_warning_but_is_said() -> None:
    channels = ('lateral', 'yaw', 'speed')
    needed, optional = Rig(channels), Rig(channels, optional_channels=('yaw',))
    for rig in (needed, optional):
        rig.hold(0.0)
        rig.tick()
        for _ in range(20):
            rig.hold(0.0)
            rig.tick()
    assert needed.detector.status.level is Level.STALE
    status = optional.detector.status
    assert status.level is Level.OK, status.reasons
    assert status.state in (State.QUIET, State.DISTURBED)
    assert status.reasons == ()
    (cost,) = status.absent
    assert cost.startswith('yaw is absent: ')
    (gone,) = (event for event in optional.events if event.event == 'input_stale')
    assert 'yaw: silent for 0.3 s, but it is optional: ' in gone.cause
    assert gone.level is not Level.STALE
    optional.assert_replayed()
