"""
Draw docs/trip.gif: a kick in the hysteresis region, ERROR, the trip, and the same kick alone.

    python docs/animation.py

The rig is simulated; its detector, interlock and set point are those that run live. The pale
rig starts from the same state with the same noise, and nobody slows it down.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle
from matplotlib.transforms import Affine2D
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'benchmark'))

from bench_interlock import NOISE_RATIO, ROUGHNESS_M, STEP_S, Loop  # noqa: E402
from detection_rigs import BENCHES  # noqa: E402

from hunt_ros.detection import HuntingDetector  # noqa: E402
from hunt_ros.detection.configuration import DetectorConfig  # noqa: E402
from hunt_ros.dynamics.identified import IdentifiedNormalForm  # noqa: E402
from hunt_ros.dynamics.simulation import RollerRig  # noqa: E402
from hunt_ros.report.figures import style  # noqa: E402

SPEED, SEED = 7.2, 5
#: Settling before the first frame, what is shown, and when the kick comes, s.
BEFORE_S, SHOWN_S, KICK_S = 14.0, 10.0, 2.0
#: Of the kick, in units of the unstable amplitude.
KICK = 1.3
FRAMES_PER_S = 20
#: What is drawn of the wheelset moves so many times as far; it turns by a quarter of that.
LARGER = 350.0
LEVELS = {'OK': '#1a7f37', 'WARN': '#9a6700', 'ERROR': '#c1121f', 'STALE': '#6e40a0'}
PALE = '#b4b4ba'


@dataclass
class Seen:
    """What a rig did: a row every 50 ms, and the motion at the rate of the sensors."""

    time: list[float] = field(default_factory=list)
    speed: list[float] = field(default_factory=list)
    amplitude: list[float] = field(default_factory=list)
    level: list[str] = field(default_factory=list)
    state: list[str] = field(default_factory=list)
    lateral: list[np.ndarray] = field(default_factory=list)
    yaw: list[np.ndarray] = field(default_factory=list)
    tripped_s: float = np.inf

    def look(self, loop: Loop, time_s: float) -> None:
        """Add what the detector says now."""
        status = loop.detector.status
        self.time.append(time_s)
        self.speed.append(loop.measured)
        self.amplitude.append(1e3 * status.number('amplitude_m'))
        self.level.append(status.level.label)
        self.state.append(status.state.label.replace('_', ' '))


class WatchedRig(RollerRig):
    """The simulated rig, whose true motion is kept."""

    kept: list[tuple[np.ndarray, np.ndarray]]

    def advance(self, count, targets=None):
        """Keep the motion of the block."""
        block = super().advance(count, targets)
        self.kept.append((1e3 * block.true_lateral, block.yaw))
        return block


def run() -> tuple[Seen, Seen]:
    """Return what was seen of the guarded rig, and of the one that is left alone."""
    bench = BENCHES['paper']
    settings = bench.settings(SPEED, bench.broadband(SPEED, NOISE_RATIO), ROUGHNESS_M)
    roller = WatchedRig(bench.rig, settings, seed=SEED)
    roller.kept = []
    detector = HuntingDetector(DetectorConfig(), IdentifiedNormalForm(bench.form))
    guarded = Loop(roller, detector, SPEED)
    for _ in range(round(BEFORE_S / STEP_S)):
        guarded.step()
    alone = guarded.again()
    found = []
    for loop, acts in ((guarded, True), (alone, False)):
        seen = Seen()
        loop.roller.kept = []
        for number in range(round(SHOWN_S / STEP_S)):
            time_s = number * STEP_S
            if number == round(KICK_S / STEP_S):
                bench.kick(loop.roller, 'y', KICK * bench.unstable(SPEED))
            trouble = loop.step()
            if trouble and acts and np.isinf(seen.tripped_s):
                seen.tripped_s = time_s + STEP_S
                loop.stop()
            seen.look(loop, time_s + STEP_S)
        seen.lateral, seen.yaw = (list(parts) for parts in zip(*loop.roller.kept, strict=True))
        found.append(seen)
    return found[0], found[1]


class Picture:
    """The frames: rig, diagram, motion, speed, and the words above them."""

    def __init__(self, guarded: Seen, alone: Seen) -> None:
        self.guarded, self.alone = guarded, alone
        matplotlib.rcParams.update({'font.family': 'DejaVu Sans', 'font.size': 9})
        self.figure = Figure(figsize=(8.0, 4.5), dpi=100, facecolor=style.PAPER)
        self.canvas = FigureCanvasAgg(self.figure)
        self._words()
        self._rig(self.figure.add_axes((0.02, 0.05, 0.26, 0.77)))
        self._diagram(self.figure.add_axes((0.345, 0.12, 0.25, 0.70)))
        self._motion(self.figure.add_axes((0.665, 0.50, 0.32, 0.32)))
        self._speed(self.figure.add_axes((0.665, 0.12, 0.32, 0.29)))

    def _words(self) -> None:
        self.chip = FancyBboxPatch(
            (0.02, 0.885), 0.115, 0.08, boxstyle='round,pad=0.005', color='k',
            transform=self.figure.transFigure,
        )  # fmt: skip
        self.figure.add_artist(self.chip)
        text = self.figure.text
        self.level = text(0.0775, 0.925, '', color='w', size=14, weight='bold')
        self.level.set(ha='center', va='center')
        self.state = text(0.155, 0.945, '', size=12, weight='bold', va='center')
        self.cause = text(0.155, 0.897, '', size=9, color=style.MUTED, va='center')
        self.clock = text(0.985, 0.945, '', size=11, ha='right', va='center')
        where = text(0.985, 0.897, 'simulated rig, real time', size=8, color=style.MUTED)
        where.set(ha='right', va='center')

    def _rig(self, axes) -> None:
        axes.set_xlim(-1.25, 1.25)
        axes.set_ylim(-1.75, 1.75)
        axes.set_aspect('equal')
        axes.axis('off')
        words = 'wheelset on its rollers, motion enlarged'
        axes.set_title(words, size=8, color=style.MUTED, pad=2)
        for side in (-0.75, 0.75):
            axes.add_patch(Rectangle((side - 0.2, -1.55), 0.4, 3.1, fc='#e4e4e9', ec=PALE, lw=1))
        self.marks = axes.plot([], [], color=PALE, lw=1.5, solid_capstyle='butt')[0]
        self.wheelset = [
            Rectangle((-1.0, -0.06), 2.0, 0.12, fc='#4d4d52', ec='none'),
            *(Rectangle((x - 0.11, -0.62), 0.22, 1.24, fc='#2b5c8a') for x in (-0.75, 0.75)),
        ]  # fmt: skip
        for part in self.wheelset:
            axes.add_patch(part)
        self.rig = axes
        self.angle = 0.0

    def _diagram(self, axes) -> None:
        branch = BENCHES['paper'].branch
        inside = (branch.speed > 5.6) & (branch.speed < 8.6)
        for stable, line, colour in ((True, '-', style.STABLE), (False, '--', style.UNSTABLE)):
            chosen = inside & (branch.stable == stable)
            amplitude = 1e3 * branch.amplitude[chosen]
            axes.plot(branch.speed[chosen], amplitude, line, color=colour, lw=2)
        v_c = branch.critical_speed
        axes.plot([5.6, v_c], [0, 0], '-', color=style.STABLE, lw=2)
        axes.plot([v_c, 8.6], [0, 0], '--', color=style.UNSTABLE, lw=2)
        axes.text(7.55, 0.79, 'limit cycle', color=style.STABLE, size=8, ha='right', rotation=12)
        axes.text(6.55, 0.13, 'unstable', color=style.UNSTABLE, size=8, ha='right')
        frame(axes, 'speed v (m/s)', 'amplitude (mm)')
        axes.set_xlim(5.6, 8.6)
        axes.set_ylim(-0.03, 1.0)
        self.ghost = axes.plot([], [], 'o', color=PALE, ms=8)[0]
        self.trail = axes.plot([], [], color=style.INK, lw=1, alpha=0.6)[0]
        self.point = axes.plot([], [], 'o', color=style.INK, ms=8)[0]

    def _motion(self, axes) -> None:
        frame(axes, '', 'lateral y (mm)')
        axes.set_xlim(0, SHOWN_S)
        axes.set_ylim(-0.95, 0.95)
        self.left = axes.plot([], [], color=PALE, lw=0.9)[0]
        self.trace = axes.plot([], [], color=style.STABLE, lw=1.0)[0]
        words = 'pale: the same kick, nobody slows the roller'
        axes.text(0.15, -0.87, words, size=7, color=style.MUTED)
        self.kick = axes.axvline(KICK_S, color=style.MUTED, lw=1, ls=':', visible=False)
        self.kick_word = axes.text(KICK_S - 0.12, 0.72, 'kick', size=8, ha='right', visible=False)

    def _speed(self, axes) -> None:
        frame(axes, 'time (s)', 'speed (m/s)')
        axes.set_xlim(0, SHOWN_S)
        axes.set_ylim(5.7, 7.6)
        v_n = BENCHES['paper'].branch.nonlinear_critical_speed
        axes.axhline(v_n, color=style.UNSTABLE, lw=1, ls='--')
        axes.text(0.15, v_n + 0.05, f'v_n {v_n:.2f}', size=8, color=style.UNSTABLE)
        self.slow = axes.plot([], [], color=style.INK, lw=1.6)[0]
        at, colour = self.guarded.tripped_s, LEVELS['ERROR']
        self.trip = axes.axvline(at, color=colour, lw=1, visible=False)
        self.trip_word = axes.text(at + 0.12, 7.34, '', size=8, color=colour)

    def frame(self, row: int) -> Image.Image:
        """Return the picture after `row` steps of 50 ms."""
        seen, time_s = self.guarded, self.guarded.time[row]
        level = seen.level[row]
        tripped = time_s >= seen.tripped_s
        self.chip.set_color(LEVELS[level])
        self.level.set_text(level)
        self.state.set_text(f'{seen.state[row]}, amplitude {seen.amplitude[row]:.2f} mm')
        self.cause.set_text(
            'interlock TRIPPED: the roller goes below v_n'
            if tripped
            else 'hysteresis region: a bump can start hunting; interlock armed'
        )
        self.clock.set_text(f'{time_s:4.1f} s')
        self._move(row)
        self.trail.set_data(seen.speed[: row + 1], seen.amplitude[: row + 1])
        self.point.set_data([seen.speed[row]], [seen.amplitude[row]])
        self.ghost.set_data([self.alone.speed[row]], [self.alone.amplitude[row]])
        for line, of in ((self.trace, seen), (self.left, self.alone)):
            values = np.concatenate(of.lateral[: row + 1])[::5]
            line.set_data(np.linspace(0.0, time_s, values.size), values)
        self.slow.set_data(seen.time[: row + 1], seen.speed[: row + 1])
        for shown, artists in (
            (time_s > KICK_S, (self.kick, self.kick_word)),
            (tripped, (self.trip, self.trip_word)),
        ):
            for artist in artists:
                artist.set_visible(shown)
        after = seen.tripped_s - KICK_S
        self.trip_word.set_text(f'tripped {after:.2f} s after the kick')
        self.canvas.draw()
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3])

    def _move(self, row: int) -> None:
        """Draw the wheelset where it is, and turn the rollers."""
        y = LARGER * 1e-3 * self.guarded.lateral[row][-1]
        psi = LARGER * self.guarded.yaw[row][-1] / 4.0
        place = Affine2D().rotate(psi).translate(y, 0.0) + self.rig.transData
        for part in self.wheelset:
            part.set_transform(place)
        self.angle += 0.35 * self.guarded.speed[row] / SPEED
        lines_x, lines_y = [], []
        for side in (-0.75, 0.75):
            for turn in np.arange(0.0, 2.0 * np.pi, np.pi / 6.0):
                if np.cos(turn + self.angle) > 0.0:
                    height = 1.55 * np.sin(turn + self.angle)
                    lines_x += [side - 0.2, side + 0.2, np.nan]
                    lines_y += [height, height, np.nan]
        self.marks.set_data(lines_x, lines_y)


def frame(axes, across: str, up: str) -> None:
    """Give axes their labels and the look of the other figures."""
    axes.set_xlabel(across, size=8, labelpad=1)
    axes.set_ylabel(up, size=8, labelpad=1)
    axes.tick_params(labelsize=8, color=style.MUTED, length=3)
    axes.grid(color=style.GRID, lw=0.6)
    axes.set_facecolor(style.PAPER)
    for side in ('top', 'right'):
        axes.spines[side].set_visible(False)


def main() -> None:
    """Run, draw, write."""
    guarded, alone = run()
    every = round(1.0 / FRAMES_PER_S / STEP_S)
    picture = Picture(guarded, alone)
    frames = [picture.frame(row) for row in range(every - 1, len(guarded.time), every)]
    palette = frames[len(frames) // 2].quantize(48, dither=Image.Dither.NONE)
    small = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    path = Path(__file__).with_name('trip.gif')
    pause = round(1000 / FRAMES_PER_S)
    small[0].save(
        path, save_all=True, append_images=small[1:], loop=0, optimize=True,
        duration=[pause] * (len(small) - 1) + [2500],
    )  # fmt: skip
    worst, left = max(guarded.amplitude), max(alone.amplitude)
    print(f'{path.name}: {path.stat().st_size / 1e6:.2f} MB, {len(small)} frames;', end=' ')
    print(f'ERROR and trip {guarded.tripped_s - KICK_S:.2f} s after the kick;', end=' ')
    print(f'largest amplitude {worst:.2f} mm, alone {left:.2f} mm')


if __name__ == '__main__':
    main()
