"""What the detector is told in the benchmark: forms, settings, and sensors that fail."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
from detection_rigs import BENCHES, RATE_HZ
from detection_scenarios import recording

from hunt_ros.detection import DetectorConfig, HuntingDetector
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.profile.speed_profile import SpeedProfile
from hunt_ros.dynamics.simulation import RollerRig
from hunt_ros.identification import identify
from hunt_ros.samples import Record, Series

#: Standard deviations given to the true form: v_c and the coefficients, relative.
_TRUE_STD = (0.001, 0.01, 0.01, 0.01, 0.01, 0.01)
#: A failed sensor reads nothing from here on, s.
_FAILS_AT = 2.0
#: Levels of the staircase a form is refitted from, as shares of v_c.
_STAIRS = np.arange(0.75, 1.101, 0.025)


@dataclass(frozen=True)
class Knowledge:
    """
    A detector to be tried: its form, its settings, what happens to its inputs.

    `name` is its own: detectors are kept by it.
    """

    name: str
    config: DetectorConfig
    form: IdentifiedNormalForm | None = None
    damage: str = ''

    def received(self, record: Record, seed: int) -> Record:
        """Return the record as the detector gets it."""
        if self.damage == '5 % missing':
            rng = np.random.default_rng(seed)
            kept = {}
            for name, series in record.items():
                keep = rng.random(len(series)) > 0.05
                kept[name] = Series(series.stamps_ns[keep], series.values[keep])
            return Record(kept)
        if self.damage:  # '<channel> dead'
            channel = self.damage.split()[0]
            series = record[channel]
            dead = series.stamps_ns > _FAILS_AT * 1e9
            values = np.where(dead, math.nan, series.values)
            return Record({**record, channel: Series(series.stamps_ns, values)})
        return record


_FRESH: dict[str, HuntingDetector] = {}


def detector_for(knowledge: Knowledge) -> HuntingDetector:
    """Return a detector of this knowledge that has seen nothing; designed once in a process."""
    if knowledge.name not in _FRESH:
        _FRESH[knowledge.name] = HuntingDetector(knowledge.config, knowledge.form)
    return deepcopy(_FRESH[knowledge.name])


def config_of(bench: str) -> DetectorConfig:
    """Nominal frequency of the rig; everything else as it comes."""
    return DetectorConfig(hunting_frequency_hz=BENCHES[bench].form.frequency_hz)


def told_truth(bench: str, shape: bool = True) -> Knowledge:
    """The true form, 1 % on every coefficient, 0.1 % on v_c; with the mode shape or without."""
    rig = BENCHES[bench]
    form = rig.form
    values = [form.critical_speed, form.D1, form.D4, form.D7, form.D10, form.D15]
    spread = np.diag((np.array(_TRUE_STD) * values) ** 2)
    known = IdentifiedNormalForm(form, spread)
    name = f'{bench}: true form'
    if shape:
        return Knowledge(name, config_of(bench), replace(known, mode_shape=rig.shape))
    return Knowledge(f'{name}, no mode shape', config_of(bench), known)


def told_speeds(bench: str) -> Knowledge:
    """v_c and v_n alone."""
    form = BENCHES[bench].form
    config = replace(
        config_of(bench),
        critical_speed_mps=form.critical_speed,
        nonlinear_critical_speed_mps=form.nonlinear_critical_speed or 0.0,
    )
    return Knowledge(f'{bench}: only v_n and v_c', config)


def told_nothing(bench: str) -> Knowledge:
    return Knowledge(f'{bench}: nothing', config_of(bench))


def told_paper() -> Knowledge:
    """The coefficients (33), as exact."""
    form = IdentifiedNormalForm(PAPER_NORMAL_FORM)
    return Knowledge("paper: the paper's form (33)", config_of('paper'), form)


def refitted(task: tuple[str, int]) -> Knowledge | None:
    """The form identified from one staircase of the full model up and down; None: no answer."""
    bench, seed = task
    rig = BENCHES[bench]
    levels = rig.v_c * _STAIRS
    profile = SpeedProfile.staircase(*levels, *levels[-2::-1], hold_s=25.0)
    roller = RollerRig(rig.rig, rig.settings(float(levels[0]), 8e-6, 20e-6), 10_000 + seed)
    times = np.arange(int(profile.duration_s * RATE_HZ)) / RATE_HZ
    found = identify([recording([roller.advance(times.size, profile(times))])])
    name = f'{bench}: refitted from staircase {seed}'
    if found.normal_form is None:
        return None
    return Knowledge(name, config_of(bench), found.normal_form)


def impaired(bench: str) -> list[Knowledge]:
    """The true form with a wrong nominal frequency, a dead sensor, lost samples."""
    known, bare = told_truth(bench), told_truth(bench, shape=False)
    frequency = known.config.hunting_frequency_hz
    changes = [
        ('nominal frequency 20 % high', known, 1.2, ''),
        ('nominal frequency 20 % low', known, 0.8, ''),
        ('lateral dead', known, 1.0, 'lateral dead'),
        ('lateral dead, no mode shape', bare, 1.0, 'lateral dead'),
        ('yaw dead', known, 1.0, 'yaw dead'),
        ('5 % missing', known, 1.0, '5 % missing'),
    ]
    return [
        replace(
            one,
            name=f'{bench}: {name}',
            config=replace(one.config, hunting_frequency_hz=factor * frequency),
            damage=damage,
        )
        for name, one, factor, damage in changes
    ]
