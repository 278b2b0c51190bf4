"""
Soak: does the live suite still do after hours what it did in the first minute?

The seven nodes run on the simulated rig, faster than real time. The roller repeats a profile of
five minutes: quiet running, a bump inside the basin of the quiet state, a sweep through hunting
and back. Then the recording is replayed. Judged are the growth of each node's memory, losses,
alarms without a cause, doubts, and whether live run and replay say the same. Exit code 1 where
one of them misses its goal.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tables import markdown
from usage import Usage, losses

from hunt_ros.bag import read_record
from hunt_ros.cli.support import suite
from hunt_ros.cli.support.console import Console, Line
from hunt_ros.cli.support.recorded_run import recorded_run
from hunt_ros.cli.support.supervisor import Supervisor
from hunt_ros.cli.support.view import View
from hunt_ros.detection import HuntingDetector
from hunt_ros.detection.replay import detect, samples_apart
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.profile import Corners, Profile
from hunt_ros.suite import LISTENERS, SIMULATOR, SOURCES

#: One round: quiet below v_n (6.4 m/s), quiet in the hysteresis region, up through v_c (8.0 m/s),
#: hunting, and down again until it has died out.
_TIMES_S = (20.0, 40.0, 120.0, 180.0, 195.0, 270.0, 300.0)
_SPEEDS_MPS = (6.0, 7.0, 7.0, 8.8, 8.8, 6.0, 6.0)
_ROUND_S = _TIMES_S[-1]
#: A bump that the quiet state survives (the unstable branch is at 0.4 mm there): its time in a
#: round, and its size.
_KICK = (80.0, 0.1e-3)
#: Up to here nothing but a bump larger than that takes the wheelset out of the quiet state.
_QUIET_MPS = 7.3
#: Of a machine that keeps pace, and of which nothing was pulled out.
_NEVER = ('input_stale', 'sensor_fault', 'interlock_tripped')
#: The share of the run after which memory is looked at, and that of the rest which is averaged
#: at its begin and end.
_WARM_UP, _END = 0.2, 0.15
_MOST_GROWTH = 0.02
_CLOSING_S = 120.0
_Said = tuple[int, str, str]


@dataclass
class Seen:
    """What the nodes said, and the memory that each had at times."""

    said: list[_Said] = field(default_factory=list)
    health: dict[str, dict[str, str]] = field(default_factory=dict)
    begin_lost: dict[str, int] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    false_alarms: int = 0
    closed: Path | None = None
    memory: dict[str, list[Usage]] = field(default_factory=dict)

    def take(self, line: Line) -> None:
        """Take a line of the console."""
        if line['topic'] == 'recording/closed':
            self.closed = Path(line['data'])
        elif line['topic'] == '/diagnostics':
            self.health[line['name'].rsplit('/', 1)[-1]] = line
        elif line['topic'] == 'hunting/status' and line['level'] == 'OK' and not self.begin_lost:
            # Sensors start one after the other, and time runs fast: what is lost later counts.
            self.begin_lost = losses(self.health)
        elif line['topic'] == 'hunting/events':
            self.said.append((int(line['stamp_ns']), line['event'], line.get('amplitude_m', '')))
            if line['event'] == 'escaping' and float(line['speed_mps']) < _QUIET_MPS:
                self.false_alarms += 1
                print(f'escaping at {line["speed_mps"]} m/s: {line["message"]}', flush=True)


def profile(rounds: int) -> Profile:
    times, speeds = [0.0], [_SPEEDS_MPS[0]]
    for number in range(rounds):
        times += [number * _ROUND_S + time_s for time_s in _TIMES_S]
        speeds += _SPEEDS_MPS
    return Profile((Corners(tuple(times), tuple(speeds)),), 'soak')


def live(folder: Path, speedup: float, minutes: float) -> Seen:
    """Run the suite; return when the recording is closed."""
    form = folder / 'paper_normal_form.yaml'
    form.write_text(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml(), encoding='utf-8')
    rounds = int(60.0 * minutes * speedup / _ROUND_S) + 1
    kicks = [(number * _ROUND_S + _KICK[0], _KICK[1]) for number in range(rounds)]
    parameters = suite.simulated_run(folder, profile(rounds), speedup, kicks)
    common = {'use_sim_time': True} if speedup != 1.0 else {}
    seen = Seen()
    with Supervisor('rig', folder / 'logs', private=True, keep=False) as processes:
        link = Console(processes, View())
        suite.start_nodes(processes, LISTENERS, common, parameters, [form])
        link.wait_until_up(LISTENERS)
        suite.start_nodes(processes, [SIMULATOR], {}, parameters)
        suite.start_nodes(processes, SOURCES, common, parameters)
        watch(link, processes, seen, 60.0 * minutes)
        seen.lost = losses(seen.health)
        print(f'the recorder says: {seen.health["bag_recorder"]["message"]}', flush=True)
        link.call('stop-recording')
        for line in link.lines(_CLOSING_S):
            seen.take(line)
            if seen.closed:
                return seen
    raise SystemExit(f'the recording was not closed within {_CLOSING_S:.0f} s; see {folder}')


def watch(link: Console, processes: Supervisor, seen: Seen, seconds: float) -> None:
    """Listen for so long, and look at the memory a hundred times; say now and then how it goes."""
    began, looked, told = time.monotonic(), 0, 0
    while (elapsed := time.monotonic() - began) < seconds:
        for line in link.lines(min(1.0, seconds / 200.0)):
            seen.take(line)
        if elapsed < looked * seconds / 100.0:
            continue
        looked += 1
        for name, pid in processes.pids().items():
            if name != 'console':
                seen.memory.setdefault(name, []).append(Usage.of(pid))
        if elapsed >= told * seconds / 10.0:
            told += 1
            total = sum(of[-1].memory_mb for of in seen.memory.values())
            print(f'{elapsed / 60.0:.1f} min: {len(seen.said)} events, {total:.0f} MB', flush=True)


def growth(usages: Sequence[Usage]) -> tuple[float, float]:
    """Return a node's memory after the warm-up, MB, and the share by which it grew after that."""
    after = usages[round(_WARM_UP * len(usages)) :]
    count = max(1, round(_END * len(after)))
    begin, end = after[:count], after[-count:]
    memory = float(np.median([one.memory_mb for one in begin]))
    own = [float(np.median([one.own_mb for one in part])) for part in (begin, end)]
    return memory, (own[1] - own[0]) / memory


def replayed(bag: Path) -> tuple[list[_Said], int, float]:
    """Return what the replay of a recording says, the samples that lack, and its length, s."""
    run, record = recorded_run(bag), read_record(bag)
    if run is None:
        raise SystemExit(f'{bag}: the start of the detector is not in it')
    output = detect(HuntingDetector(run.config), record, run.journal)
    said = [(one.stamp_ns, one.event, str(one.number('amplitude_m'))) for one in output.events]
    lack = sum(sum(counts.values()) for counts in samples_apart(record, run.journal))
    for series in record.values():  # the simulated rig samples evenly
        steps = np.diff(series.stamps_ns)
        lack += int((np.rint(steps / np.median(steps)) - 1).sum())
    return said, lack, record.duration_s


def judge(seen: Seen) -> bool:
    """Print what was measured beside each goal; return True if all are met."""
    rows: list[tuple[str, str, str, bool]] = []
    for name, usages in sorted(seen.memory.items()):
        memory, grown = growth(usages)
        rows.append(
            (
                f'memory of {name}, {memory:.0f} MB: grown by',
                f'{100.0 * grown:.2f} %',
                f'at most {100.0 * _MOST_GROWTH:.0f} %',
                grown <= _MOST_GROWTH,
            )
        )
    lost = {who: count - seen.begin_lost[who] for who, count in seen.lost.items()}
    counts = {f'lost by {who}': count for who, count in lost.items()}
    assert seen.closed is not None
    again, lack, duration_s = replayed(seen.closed)
    heard = [one for one in seen.said if not one[1].startswith('interlock')]
    # The recorder may have closed while the detector went on.
    first = next((said for said in zip(heard, again, strict=False) if said[0] != said[1]), None)
    if first:
        print('the first event that differs, live and replayed: {} {}'.format(*first))
    other = sum(one != two for one, two in zip(heard, again, strict=False))
    other += max(0, len(again) - len(heard))
    words = Counter(word for _, word, _ in seen.said)
    counts['samples that the recording lacks'] = lack
    counts['false escaping'] = seen.false_alarms
    counts |= {f'events {word}': words[word] for word in _NEVER}
    counts[f'of {len(again)} events, other than live'] = other
    rows += [(what, str(count), '0', not count) for what, count in counts.items()]
    hunted = words['limit_cycle']
    rounds = int(duration_s / _ROUND_S)
    rows.append((f'limit cycles in {rounds} whole rounds', str(hunted), 'each', hunted >= rounds))
    print(f'\n{duration_s / 3600.0:.2f} h of the rig\n')
    table = [[what, got, goal, 'yes' if met else '**no**'] for what, got, goal, met in rows]
    print(markdown(['', 'measured', 'goal', 'met'], table))
    return all(met for *_, met in rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--minutes', type=float, default=60.0, help='of this machine')
    parser.add_argument('--speedup', type=float, default=8.0, help='seconds of the rig in one')
    parser.add_argument('--out', type=Path, help='keep logs and recording here')
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        met = judge(live(folder, arguments.speedup, arguments.minutes))
    raise SystemExit(not met)


if __name__ == '__main__':
    main()
