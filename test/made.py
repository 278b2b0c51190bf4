"""Records, rigs and profiles that tests of several rooms make."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from runpy import run_path
from typing import Any
from unittest import mock

import numpy as np
from scipy.signal import lfilter
from scipy.stats import binom

from hunt_ros.bag import write_record
from hunt_ros.detection.output import Output
from hunt_ros.dynamics.growth_law import PAPER_TERMS, GrowthLaw, GrowthScales, lawful, reading
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM, NormalForm
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.dynamics.profile import Corners, Hold, Profile
from hunt_ros.dynamics.simulation import (
    DriveModel,
    Kick,
    Roughness,
    SensorModel,
    SimulationSettings,
    simulate,
)
from hunt_ros.samples import Record, Series

SECOND = 1_000_000_000


def from_normal_form(form: NormalForm, scales: GrowthScales) -> np.ndarray:
    """Coefficients of the paper's form, shape (6,); the inverse of `to_normal_form`."""
    ratio = (scales.amplitude / (2.0 * form.length_scale)) ** 2
    about = [0.0, form.D1, form.D7, form.D4 * ratio, form.D10 * ratio, form.D15 * ratio**2]
    there = reading(0.0, math.log(scales.speed / form.critical_speed)) @ lawful(about)
    return there[:PAPER_TERMS] / form.time_scale


#: The normal form of the paper, taken as exact.
PAPER = IdentifiedNormalForm(PAPER_NORMAL_FORM)
#: Its law, in scales near its own.
SCALES = GrowthScales(7.4, 7e-4, 0.0485, 1.0 / 25.91, 2.84)
LAW = GrowthLaw(lawful(from_normal_form(PAPER_NORMAL_FORM, SCALES)), SCALES)

#: Recordings of a real rig with the same bifurcation, where they are.
FLUTTER = Path(__file__).parents[2] / 'shared' / 'data' / 'flutter_rig'

Values = np.ndarray | float | Series | Callable[[np.ndarray], np.ndarray]


def stamps_of(seconds: np.ndarray) -> np.ndarray:
    """Return stamps, ns."""
    return np.round(1e9 * np.asarray(seconds)).astype(np.int64)


def record_of(seconds: np.ndarray, source: str = '', **values: np.ndarray | float) -> Record:
    """Return channels that share their times, s; a number is a channel that does not change."""
    stamps = stamps_of(seconds)
    channels = {n: Series(stamps, np.full(stamps.shape, v)) for n, v in values.items()}
    return Record(channels, source)


def changed(record: Record, **values: Values) -> Record:
    """Return a record with other values in some channels: new ones, or a function of the old."""
    series = {}
    for name, value in values.items():
        old = record[name]
        if isinstance(value, Series):
            series[name] = value
        else:
            new = value(old.values) if callable(value) else value
            series[name] = Series(old.stamps_ns, np.full(old.values.shape, new))
    return Record({**record, **series}, record.source, record.notes)


def flutter_runs(pattern: str) -> list[Record]:
    """Return recordings of `FLUTTER`: heave and airspeed, the day in the notes."""
    from scipy.io import loadmat

    runs = []
    for path in sorted(FLUTTER.glob(pattern)):
        data = loadmat(path)['data']
        seconds = np.arange(data.shape[1]) / 250.0
        airspeed = float(path.name.split('_V')[1][:3]) / 10.0
        record = record_of(seconds, path.name, lateral=0.47 * data[1], speed=airspeed)
        runs.append(Record(record, path.name, {'day': path.name[:8]}))
    return runs


def without(record: Record, *names: str) -> Record:
    """Return a record that lacks some channels."""
    return Record({key: one for key, one in record.items() if key not in names}, record.source)


def dead(record: Record, channel: str, from_s: float = 0.0, value: float = np.nan) -> Record:
    """Return a record in which a channel reads one value from some time on, s."""
    series = record[channel]
    values = np.where(series.stamps_ns >= from_s * SECOND, value, series.values)
    return changed(record, **{channel: values})


def forced_mode(
    rng: np.random.Generator,
    count: int,
    step_s: float,
    damping: float,
    std: float,
    hz: float = 0.0,
) -> np.ndarray:
    """Return a damped mode that noise drives, exact at the steps; `std` is that of each part."""
    keep = np.exp((-damping + 2j * np.pi * hz) * step_s)
    push = std * (rng.standard_normal((count, 2)) @ np.array([1.0, 1.0j]))
    push[1:] *= np.sqrt(1.0 - abs(keep) ** 2)
    return lfilter([1.0], [1.0, -keep], push)


def rig_settings(
    rate_hz: float = 500.0,
    broadband: float = 8e-6,
    roughness: Sequence[float] = (),
    **more: object,
) -> SimulationSettings:
    """Return the simulated rig with the noise of its two sensors."""
    return SimulationSettings(
        sample_rate_hz=rate_hz,
        broadband=broadband,
        roughness=Roughness(tuple(roughness)),
        lateral_sensor=SensorModel(noise=5e-6),
        yaw_sensor=SensorModel(noise=2e-5),
        **more,  # type: ignore[arg-type]
    )


#: The rig with all that the simulator has: noise, steps of a sensor, a drive that is not exact.
BUSY = SimulationSettings(
    initial_speed=7.0,
    roughness=Roughness((40e-6, 10e-6), (3e-6,)),
    broadband=1e-5,
    lateral_sensor=SensorModel(5e-6, 1e-6),
    yaw_sensor=SensorModel(2e-5),
    drive=DriveModel(speed_noise=1e-3, speed_gain=1.002),
)


def up_and_down(speeds: Sequence[float], hold_s: float) -> Profile:
    """Return a staircase over these speeds, m/s, and back."""
    up = [float(speed) for speed in speeds]
    return Profile(tuple(Hold(speed, hold_s) for speed in (*up, *up[-2::-1])))


def sweep_bag(folder: Path, seed: int) -> Path:
    """Write a sweep of the simulated rig up and down, with bumps on the way up; return it."""
    profile = Profile((Corners((0.0, 140.0, 280.0), (6.0, 8.8, 6.0)),))
    kicks = [Kick(at, lateral_m=1e-4) for at in (30.0, 60.0, 90.0)]
    record = simulate(paper_rig(), rig_settings(100.0), profile, kicks=kicks, seed=seed)
    return write_record(folder / f'sweep_{seed}', record)


def held(speed: float) -> Profile:
    """Return one speed, m/s, for as long as the record is."""
    return Profile((Hold(speed, 0.0),))


def words(output: Output) -> list[str]:
    """Return the words of the events."""
    return [event.event for event in output.events]


def numbers(entry: object) -> Iterator[float]:
    """Yield every number of a document."""
    below = entry.values() if isinstance(entry, dict) else entry if isinstance(entry, list) else ()
    for one in below:
        yield from numbers(one)
    if isinstance(entry, int | float):
        yield float(entry)


def python(*words: object, cwd: Path | None = None, code: int | None = 0, **environment: str):
    """Run Python in a process of its own; return what came of it. `code` None: any exit code."""
    done = subprocess.run(
        [sys.executable, *map(str, words)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, **environment},
        timeout=900,
    )
    assert code is None or done.returncode == code, done.stdout[-4000:] + done.stderr[-2000:]
    return done


def at_most(rate: float, trials: int) -> int:
    """Return how many of the trials may go wrong by chance, but for one suite in ten thousand."""
    return int(binom.ppf(1.0 - 1e-4, trials, rate))


def install_driver(folder: Path, name: str, code: str, entry: str = '') -> None:
    """Put a driver of a third party into a folder, as pip does; `entry`: of its setup.py."""
    (folder / f'{name}.py').write_text(code)
    info = folder / f'{name}-1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n')
    entry = entry or f'{name} = {name}'
    (info / 'entry_points.txt').write_text(f'[hunt_ros.drivers]\n{entry}\n')


def declared() -> dict[str, Any]:
    """What setup.py declares."""
    given: dict[str, Any] = {}
    with mock.patch('setuptools.setup', given.update):
        run_path(str(Path(__file__).parents[1] / 'setup.py'))
    return given
