"""
The interlock in closed loop: limit cycles that it avoids on the simulated rig.

    make bench-interlock              # KICKS=20: fewer

A kick of 0.8 to 1.5 times the unstable amplitude, at a speed inside the hysteresis region, with
broadband forcing and roughness. Those that end in a limit cycle when nobody acts are repeated,
from the same state and with the same noise: with the interlock in `protect`, and with an operator
who stops the roller 2 s after the alarm. Both slow the roller down alike. How soon the railway
criteria would speak: bench_detection.py.
"""

from __future__ import annotations

import copy
import math
from argparse import Namespace
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
from detection_rigs import BENCHES, RATE_HZ, WAYS
from tables import mapped, markdown, run

from hunt_ros.detection import HuntingDetector
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.drivers.command import DriveLimits, RollerCommand
from hunt_ros.drivers.interlock import Heard, Interlock, InterlockSettings
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.profile import Hold, Motion, Profile
from hunt_ros.dynamics.simulation import RollerRig

#: As often as the status comes, s and samples.
STEP_S = 0.05
STEP = round(STEP_S * RATE_HZ)
QUIET_S, PATIENCE_S = 12.0, 60.0
REACTION_S = 2.0
ROUGHNESS_M = 20e-6
#: Rms of the quiet amplitude over the unstable amplitude.
NOISE_RATIO = 0.05
#: Keys of the status that the interlock reads.
MOTION = ('amplitude_m', 'v_n_mps', 'v_c_mps', 'fold_amplitude_m')


@dataclass
class Loop:
    """A rig, its detector, its drive: all that goes on while it runs."""

    roller: RollerRig
    detector: HuntingDetector
    speed: float
    interlock: Interlock = field(
        default_factory=lambda: Interlock(InterlockSettings(safe_margin_mps=0.3))
    )
    command: RollerCommand = field(default_factory=lambda: RollerCommand(DriveLimits()))
    now_ns: int = 0
    amplitude: float = 0.0
    measured: float = math.nan

    def __post_init__(self) -> None:
        self.measured = self.speed
        self.interlock.lost = ''
        self.command.profile = Profile((Hold(self.speed, 1e5),))
        self.command.start()

    def again(self) -> Loop:
        """Return the same loop once more: state and noise to come are the same."""
        names = ('roller', 'detector', 'interlock')
        parts = {name: copy.deepcopy(getattr(self, name)) for name in names}
        return Loop(speed=self.speed, now_ns=self.now_ns, amplitude=self.amplitude, **parts)

    def step(self) -> str:
        """Go on by 50 ms; return what trips the interlock now, or ''."""
        target = self.command.next(STEP_S, self.measured, Motion())
        assert target is not None
        self.command.taken(target)
        block = self.roller.advance(STEP, np.full(STEP, target))
        for name, stamps, values in (
            ('lateral', block.stamps_ns, block.lateral),
            ('yaw', block.stamps_ns, block.yaw),
            ('roller', block.stamps_ns, block.roller_angle),
            ('speed', block.stamps_ns, block.speed),
        ):
            self.detector.update(name, stamps, values)
        self.measured = float(block.speed[-1])
        self.now_ns = int(block.stamps_ns[-1])
        self.amplitude = 0.5 * max(0.9 * self.amplitude, float(np.ptp(block.true_lateral)))
        status = self.detector.status
        seen = Motion(*(status.number(key) for key in MOTION))
        words = '; '.join(status.reasons)
        self.interlock.hear(
            self.now_ns,
            Heard(
                status.level.label,
                int(status.number('sequence')),
                status.stamp_ns,
                words,
                status.number('envelope_m'),
                seen,
                undecided=bool(status.values['undecided']),
                frequency_hz=status.number('frequency_hz'),
            ),
        )
        return self.interlock.trouble(self.now_ns).words

    def stop(self) -> None:
        """Slow the roller down, as the interlock does."""
        self.command.trip(self.interlock.safe_speed_mps(), self.measured)


@dataclass(frozen=True)
class Course:
    """What came of a kick: whether it hunted, and when the roller was slowed, s after it."""

    hunted: bool
    acted_s: float
    largest_m: float


def course(loop: Loop, way: str, cycle_m: float) -> Course:
    """Go on after the kick until it hunts or is quiet again; `way`: who slows the roller."""
    alarmed_s = acted_s = math.inf
    largest = 0.0
    v_n = loop.detector.status.number('v_n_mps')
    recent: list[float] = []
    for number in range(round(PATIENCE_S / STEP_S)):
        trouble = loop.step()
        since_s = (number + 1) * STEP_S
        if trouble:
            alarmed_s = min(alarmed_s, since_s)
        says = {
            'nobody': False,
            'protect': bool(trouble),
            'operator': since_s >= alarmed_s + REACTION_S,
        }
        if math.isinf(acted_s) and says[way]:
            acted_s = since_s
            loop.stop()
        motion = loop.roller.motion
        recent = [*recent[-8:], abs(motion[0])]  # more than a period
        largest = max(largest, max(recent) if since_s > 1.0 else 0.0)
        if largest > 0.9 * cycle_m:
            return Course(True, acted_s, largest)
        if loop.measured < v_n - 0.1 or (since_s > 5.0 and max(recent) < 0.25 * cycle_m / 2.0):
            break
    return Course(False, acted_s, largest)


def kicked(seed: int) -> dict[str, Course]:
    """Make one kick; return what came of it, by who watched."""
    rng = np.random.default_rng(seed)
    bench = BENCHES['paper']
    speed = float(rng.uniform(6.7, 7.7))
    edge, cycle = bench.unstable(speed), bench.stable(speed)
    noise = bench.broadband(speed, NOISE_RATIO)
    roller = RollerRig(bench.rig, bench.settings(speed, noise, ROUGHNESS_M), seed=seed)
    detector = HuntingDetector(DetectorConfig(), IdentifiedNormalForm(bench.form))
    loop = Loop(roller, detector, speed)
    for _ in range(round(QUIET_S / STEP_S)):
        loop.step()
    bench.kick(roller, WAYS[seed % len(WAYS)], float(rng.uniform(0.8, 1.5)) * edge)
    found = {'nobody': course(loop.again(), 'nobody', cycle)}
    found['protect'] = course(loop.again(), 'protect', cycle)
    if found['nobody'].hunted:
        found['operator'] = course(loop.again(), 'operator', cycle)
    return found


def measured(arguments: Namespace, pool: Executor) -> str:
    """Return the table."""
    runs = mapped(pool, 'kicks', kicked, range(arguments.kicks))
    hunting = [one for one in runs if one['nobody'].hunted]
    rows = []
    for way, words in (
        ('protect', 'interlock in `protect`'),
        ('operator', f'operator, {REACTION_S:g} s after the alarm'),
    ):
        avoided = sum(not one[way].hunted for one in hunting)
        times = sorted(one[way].acted_s for one in hunting)
        largest = [1e3 * one[way].largest_m for one in hunting]
        calm = [one[way] for one in runs if way in one and not one['nobody'].hunted]
        needless = '-' if not calm else f'{sum(math.isfinite(c.acted_s) for c in calm)}'
        middle = times[len(times) // 2] if times else math.nan
        rows.append(
            [words, f'{avoided} of {len(hunting)}', middle, float(np.median(largest)), needless]
        )
    calm_count = len(runs) - len(hunting)
    header = [
        'who slows the roller',
        'limit cycles avoided',
        'slowed after, s (median)',
        'largest displacement, mm (median)',
        f'slowed needlessly, of {calm_count}',
    ]
    text = f"{len(runs)} kicks of 0.8 to 1.5 A_u at 6.7 to 7.7 m/s, the paper's rig, "
    text += f'{len(hunting)} of them end in a limit cycle when nobody acts; drive: 1 m/s2, lag'
    return f'{text} 0.3 s.\n\n{markdown(header, rows)}'


if __name__ == '__main__':
    run(__doc__, 'bench-interlock', 'The interlock', measured, kicks=(100, 2))
