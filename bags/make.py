"""
Make the golden recordings again, and the events expected of them.

    python bags/make.py [--only NAME] [--events]

Everything is seeded: the same command gives the same motion on every machine, to rounding.
With --events the recordings stay, and only the expected events are written anew; look at the
difference before you commit it.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

from hunt_ros.bag import BagWriter, write_record
from hunt_ros.bag.cdr.message_types import standard_types
from hunt_ros.bag.mcap.file import McapFile
from hunt_ros.bag.mcap.writer import McapWriter
from hunt_ros.bag.messages import STRING
from hunt_ros.bag.record_writer import messages_of
from hunt_ros.bag.repair import repair
from hunt_ros.cli.main import main as hunt
from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import RigParameters, paper_rig
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.dynamics.simulation import (
    Kick,
    Roughness,
    SensorModel,
    SimulationSettings,
    simulate,
)
from hunt_ros.samples import Record

HERE = Path(__file__).parent

#: 100 Hz, and the steps of a good converter: small files that are still measurements.
SETTINGS = SimulationSettings(
    sample_rate_hz=100.0,
    roughness=Roughness((20e-6,)),
    broadband=8e-6,
    lateral_sensor=SensorModel(noise=5e-6, resolution=2.0**-21),
    yaw_sensor=SensorModel(noise=2e-5, resolution=2.0**-18),
)
#: A soft rig: the same wheelset with a tread that stiffens with amplitude.
SUPERCRITICAL = replace(paper_rig(), beta={'30': -250.0}, name='supercritical')


def record_of(
    rig: RigParameters, profile: Profile, kicks: list[tuple[float, float]], seed: int
) -> Record:
    """Simulate a rig over a profile, with blows at (time, size)."""
    blows = [Kick(time_s, lateral_m=size) for time_s, size in kicks]
    return simulate(rig, SETTINGS, profile, profile.duration_s, kicks=blows, seed=seed)


def hold(*corners: tuple[float, float]) -> Profile:
    """Return the profile through corners (s, m/s)."""
    times, speeds = zip(*corners, strict=True)
    return Profile((Corners(tuple(times), tuple(speeds)),))


def hysteresis_loop() -> Record:
    """Up through v_n and v_c into hunting, and down again until it stops."""
    corners = ((0.0, 6.0), (10.0, 6.0), (80.0, 8.8), (90.0, 8.8), (160.0, 6.0), (170.0, 6.0))
    return record_of(paper_rig(), hold(*corners), [], seed=11)


def kick_decays() -> Record:
    """Blows inside the basin of the quiet state at 7.2 m/s: each dies away."""
    kicks = [(10.0, 60e-6), (20.0, 90e-6), (32.0, 120e-6)]
    return record_of(paper_rig(), hold((0.0, 6.0), (6.0, 7.2), (45.0, 7.2)), kicks, seed=12)


def kick_escapes() -> Record:
    """One blow beyond the unstable branch at 7.2 m/s; slowed below v_n, it stops."""
    corners = ((0.0, 6.0), (6.0, 7.2), (35.0, 7.2), (41.0, 6.0), (55.0, 6.0))
    return record_of(paper_rig(), hold(*corners), [(15.0, 320e-6)], seed=13)


def supercritical() -> Record:
    """A rig without hysteresis: hunting grows and goes with the speed."""
    corners = ((0.0, 7.0), (8.0, 7.0), (40.0, 8.8), (60.0, 8.8), (92.0, 7.0), (105.0, 7.0))
    return record_of(SUPERCRITICAL, hold(*corners), [], seed=14)


RECORDS: dict[str, Callable[[], Record]] = {
    'hysteresis_loop': hysteresis_loop,
    'kick_decays': kick_decays,
    'kick_escapes': kick_escapes,
    'supercritical': supercritical,
}
DAMAGED = 'damaged'
#: Normal form that each is replayed with.
FORMS = dict.fromkeys(RECORDS, 'paper.yaml') | {'supercritical': 'supercritical.yaml'}


def write_forms() -> None:
    """Write the parameter files of the normal forms that the recordings are replayed with."""
    derived = normal_form_of(SUPERCRITICAL).amplitude_coordinate
    for name, form, origin in (
        ('paper', PAPER_NORMAL_FORM, 'Eq. (33) of the paper'),
        ('supercritical', derived, 'the equations of the rig, by centre manifold'),
    ):
        text = IdentifiedNormalForm(form, provenance={'from': origin}).to_yaml()
        (HERE / f'{name}.yaml').write_text(text, encoding='utf-8')


def write_bag(name: str) -> None:
    """Simulate and write one recording."""
    target = HERE / name
    shutil.rmtree(target, ignore_errors=True)
    form = (HERE / FORMS[name]).read_text(encoding='utf-8')
    notes = {
        'rig': 'simulated',
        'operator': 'bags/make.py',
        'notes': ' '.join((RECORDS[name].__doc__ or '').split()),
    }
    record, types = RECORDS[name](), standard_types()
    message = types.serialize_cdr(types.types[STRING](data=form), STRING)
    with BagWriter(target, notes=notes) as bag:
        topic = bag.topic('/rig/hunting/normal_form', STRING, latched=True)
        bag.write(topic, record.start_ns, message)
        for one in messages_of(record, bag.topic, 'rig'):
            bag.write(*one)


def write_damaged() -> None:
    """The escape again, in short chunks: one has a wrong byte, and the end is cut off."""
    short = patch.object(McapWriter, 'chunk_bytes', 1 << 16)
    with short, tempfile.TemporaryDirectory() as scratch:
        folder = write_record(Path(scratch) / 'run', kick_escapes())
        data = bytearray((folder / 'run_0.mcap').read_bytes())
        with closing(McapFile(folder / 'run_0.mcap')) as file:
            chunks = file.chunks
    bad = chunks[len(chunks) // 5]
    data[bad.data + bad.stored // 2] ^= 0xFF
    cut = chunks[-1].offset + chunks[-1].stored // 2
    (HERE / 'damaged.mcap').write_bytes(data[:cut])


def write_events(name: str) -> None:
    """What `hunt replay` says of it: the golden events; of a damaged one, of its repair."""
    target = HERE / f'{name}.json'
    with tempfile.TemporaryDirectory() as scratch:
        source = HERE / name
        if not source.exists():
            source = repair(HERE / f'{name}.mcap', Path(scratch) / 'saved').path
        _replay(source, HERE / FORMS.get(name, 'paper.yaml'), target)


def _replay(source: Path, form: Path, target: Path) -> None:
    words = ['replay', str(source), '--normal-form', str(form)]
    if hunt([*words, '--json', str(target)]) != 0:
        raise SystemExit(f'hunt replay failed on {source}')
    document = json.loads(target.read_text(encoding='utf-8'))
    target.write_text(json.dumps(document, indent=1) + '\n', encoding='utf-8')


def main() -> int:
    """Make what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--only', choices=[*RECORDS, DAMAGED], help='this one')
    parser.add_argument('--events', action='store_true', help='only the expected events')
    arguments = parser.parse_args()
    if not arguments.events:
        write_forms()
    for name in [arguments.only] if arguments.only else [*RECORDS, DAMAGED]:
        if not arguments.events:
            write_damaged() if name == DAMAGED else write_bag(name)
        write_events(name)
    sizes = {path.name: path.stat().st_size for path in HERE.rglob('*.mcap')}
    print(
        f'{sum(sizes.values()) / 1e6:.2f} MB in {len(sizes)} files, largest {max(sizes.values())}'
    )
    return 0


if __name__ == '__main__':
    sys.exit(main())
