"""The kinds of steps of a speed profile."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

from hunt_ros.dynamics.profile.step import Leg, Motion, Scene, Step
from hunt_ros.errors import ConfigError
from hunt_ros.settings import setting

#: Of a value that must be given.
_REQUIRED = math.nan
_FASTEST_MPS = 100.0
_LONGEST_S = 604_800.0
#: Of the see-saw, in parts of the hysteresis region and of the amplitude at the fold.
_WATCHED = (0.36, 0.74, 0.49, 0.62)
_FALLEN, _GROWN = 0.7, 0.3
#: What is held within this of a step, m/s, and for so long, s, is that step.
_NEAR_MPS, _HELD_S = 0.1, 2.0
#: The see-saw goes so much lower where hunting does not die out.
_LOWER_MPS = 0.1
#: Why a climb cannot be.
_NO_DETECTOR = (
    'a detector has to clear each speed, and there is none (hunt simulate has none: hunt run has)'
)
#: Key of the see-saw -> what of the form it follows from.
_FROM_FORM = {
    'low_mps': 'v_n',
    'high_mps': 'v_c',
    'watch_low_mps': 'v_n',
    'watch_high_mps': 'v_c',
    'grown_m': 'fold_amplitude_m',
    'fallen_m': 'fold_amplitude_m',
}


def _speed(description: str, default: float = _REQUIRED) -> Any:
    return setting(default, description, unit='m/s', low=0.0, high=_FASTEST_MPS)


def _rate(default: float) -> Any:
    what = 'how fast the set point changes'
    return setting(default, what, unit='m/s2', low=1e-4, high=100.0)


def _time(description: str, default: float = _REQUIRED, low: float = 0.0) -> Any:
    return setting(default, description, unit='s', low=low, high=_LONGEST_S)


def _amplitude(description: str) -> Any:
    return setting(0.0, description, unit='m', low=0.0, high=1.0)


@dataclass(frozen=True)
class _GoTo(Step):
    """Go to a speed; an amplitude may end it."""

    speed_mps: float = _speed('where to')
    _: KW_ONLY
    until_above_m: float = _amplitude('ends as soon as the amplitude is above this (0: not)')
    until_below_m: float = _amplitude('ends as soon as the amplitude is below this (0: not)')

    def _leg(self, rate_mps2: float, hold_s: float) -> Leg:
        above, below = self.until_above_m or math.nan, self.until_below_m or math.nan
        return Leg(self.speed_mps, rate_mps2, hold_s, above, below)

    @property
    def reacts(self) -> bool:
        """True where an amplitude may end it."""
        return bool(self.until_above_m or self.until_below_m)


@dataclass(frozen=True)
class Hold(_GoTo):
    """Stay at a speed."""

    duration_s: float = _time('how long, the way there not counted')
    rate_mps2: float = _rate(0.2)

    def legs(self, scene: Scene) -> Iterator[Leg]:
        """Iterate over the one leg."""
        yield self._leg(self.rate_mps2, self.duration_s)


@dataclass(frozen=True)
class Ramp(_GoTo):
    """Go to a speed."""

    rate_mps2: float = _rate(0.1)

    def legs(self, scene: Scene) -> Iterator[Leg]:
        """Iterate over the one leg."""
        yield self._leg(self.rate_mps2, 0.0)


@dataclass(frozen=True)
class Sweep(Step):
    """Go from one speed to another and back."""

    low_mps: float = _speed('from here')
    high_mps: float = _speed('to here')
    rate_mps2: float = _rate(0.02)
    hold_s: float = _time('at the top', 0.0)
    back: bool = setting(True, 'and back again')

    def legs(self, scene: Scene) -> Iterator[Leg]:
        """Go to the beginning, up, and down."""
        yield Leg(self.low_mps, max(self.rate_mps2, 0.2))
        yield Leg(self.high_mps, self.rate_mps2, self.hold_s)
        if self.back:
            yield Leg(self.low_mps, self.rate_mps2)


@dataclass(frozen=True)
class _Stairs(Step):
    """Steps between two speeds."""

    low_mps: float = _speed('the lowest step')
    high_mps: float = _speed('the highest step')
    step_mps: float = setting(0.2, 'height of a step', unit='m/s', low=1e-3, high=_FASTEST_MPS)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.high_mps < self.low_mps:
            raise ConfigError(f'high_mps: {self.high_mps:g} is below low_mps ({self.low_mps:g})')


@dataclass(frozen=True)
class Staircase(_Stairs):
    """Go up in steps, and down again."""

    hold_s: float = _time('on each step', 25.0)
    rate_mps2: float = _rate(0.2)
    back: bool = setting(True, 'and down again')

    @property
    def levels(self) -> list[float]:
        """Speeds of the steps, m/s."""
        count = math.ceil((self.high_mps - self.low_mps) / self.step_mps - 1e-9)
        up = [self.low_mps + k * self.step_mps for k in range(count)] + [self.high_mps]
        return [*up, *up[-2::-1]] if self.back else up

    def legs(self, scene: Scene) -> Iterator[Leg]:
        """One leg a step."""
        for speed in self.levels:
            yield Leg(speed, self.rate_mps2, self.hold_s)


@dataclass(frozen=True)
class Climb(_Stairs):
    """
    Go up in steps, each once the one before is cleared; else back to the lowest, and end.

    The practice of flight flutter tests: at each speed it waits until what is asked for is kept,
    and what is not known is not. It goes back where that takes too long, and at once where it
    hunts or what was kept is so no more.
    """

    resumable: ClassVar[bool] = False  # what was cleared before a stop is not so any more
    step_mps: float = setting(0.2, 'height of a step', unit='m/s', low=0.05, high=_FASTEST_MPS)
    rate_mps2: float = _rate(0.2)
    margin: float = setting(2.0, 'margin that is kept with 95 % (0: any)', low=0.0, high=1e6)
    escape_chance: float = setting(
        0.05, 'chance of an escape in ten minutes that is kept (1: any)', low=0.0, high=1.0
    )
    forecast_mps: float = setting(
        0.0, 'v_c is forecast to be so much higher with 95 % (0: any)', unit='m/s', low=0.0
    )
    wait_s: float = _time('the longest wait on a step', 120.0)
    hold_s: float = _time('and so long on it from then on', 0.0)

    @property
    def levels(self) -> list[float]:
        """Speeds of the steps, m/s: of equal height, which the speed that is held can tell."""
        height = self.high_mps - self.low_mps
        count = math.ceil(height / self.step_mps - 1e-9)
        return [self.low_mps + height * k / count for k in range(count)] + [self.high_mps]

    def legs(self, scene: Scene) -> Iterator[Leg]:
        """Wait on each step, and stay there; or go back."""
        for level, before in zip(self.levels, [math.nan, *self.levels], strict=False):
            yield from self._step(scene, level, before)

    def _step(self, scene: Scene, level: float, before: float) -> Iterator[Leg]:
        """Iterate over the legs of one step, of which the way back is the last."""

        def against(motion: Motion) -> str:
            """Return what speaks against this step."""
            return self._against(motion, level, before)

        def decided(motion: Motion) -> bool:
            """Return True where waiting on brings nothing."""
            return not against(motion) or motion.margin < 1.0

        # Nothing is decided on the way, where a slow roller counts as held.
        yield Leg(level, self.rate_mps2, until=_hunts)
        yield Leg(level, self.rate_mps2, self.wait_s, until=decided)
        if self.hold_s and not against(scene.motion):
            yield Leg(level, self.rate_mps2, self.hold_s, until=lambda seen: bool(against(seen)))
        if why := against(scene.motion):
            note = f'back to {self.low_mps:g} m/s: {level:g} m/s is not cleared ({why})'
            yield Leg(self.low_mps, self.rate_mps2, note=note, last=True)

    def _against(self, motion: Motion, level: float, before: float) -> str:
        """Return '' where this speed, not the step before, is held and all is kept; or why not."""
        near = _NEAR_MPS if math.isnan(before) else min(_NEAR_MPS, 0.4 * (level - before))
        if _hunts(motion):
            return 'margin 0: it hunts'
        if not (abs(motion.held_mps - level) <= near and motion.held_s >= _HELD_S):
            return 'it is not held'
        if self.margin and not motion.margin >= self.margin:
            return f'margin {_told(motion.margin)}, expected {self.margin:g} or more'
        if self.escape_chance < 1.0 and not motion.escape_chance <= self.escape_chance:
            chance = _told(motion.escape_chance)
            return f'chance of escape {chance}, expected {self.escape_chance:g} or less'
        if self.forecast_mps and not motion.forecast_mps - level >= self.forecast_mps:
            v_c = _told(motion.forecast_mps)
            return f'forecast of v_c {v_c} or more, expected {level + self.forecast_mps:g} m/s'
        return ''

    def plan(self) -> list[Leg]:
        """Return the legs of a rig on which every step waits for as long as it may."""
        return [Leg(level, self.rate_mps2, self.wait_s + self.hold_s) for level in self.levels]

    def missing(self, motion: Motion) -> str:
        """A detector has to judge the speeds that are held, and what hunts has to die out."""
        name = 'v_c' if math.isnan(motion.v_n) else 'v_n'
        if self.low_mps >= (limit := getattr(motion, name)):
            got = f'{limit:.2f} m/s, got {self.low_mps:g}'
            return f'low_mps: hunting does not die out above {name}, {got}'
        return _NO_DETECTOR if math.isnan(motion.held_s) else ''

    @property
    def reacts(self) -> bool:
        """The detector decides how far it goes."""
        return True


def _hunts(motion: Motion) -> bool:
    """Return True where it hunts, which no climb allows, whatever it asks for."""
    return motion.margin <= 0.0


def _told(value: float) -> str:
    return 'not known' if math.isnan(value) else f'{value:.2g}'


@dataclass(frozen=True)
class Seesaw(Step):
    """
    Cross the middle amplitudes again and again, by reversals that the amplitude triggers.

    Information about the growth law accrues where the amplitude moves, not where it waits on a
    branch. From the quiet state go up past v_c; when the motion has grown, go down to just
    below v_n; the moment it has fallen below the fold, go up into the hysteresis region and
    watch where it goes. Where hunting does not die out within `watch_s`, go lower. What is 0
    follows from the normal form in force.
    """

    duration_s: float = _time('how long; then down to the lowest speed')
    low_mps: float = _speed('where hunting dies out (0: 0.1 m/s below v_n)', 0.0)
    high_mps: float = _speed('where it grows by itself (0: 0.4 m/s above v_c)', 0.0)
    watch_low_mps: float = _speed('lowest speed to watch at (0: from v_n and v_c)', 0.0)
    watch_high_mps: float = _speed('highest speed to watch at (0: from v_n and v_c)', 0.0)
    watch_s: float = _time('how long to watch where the motion goes', 12.0)
    grown_m: float = _amplitude('reverse above this (0: 0.3 of the amplitude at the fold)')
    fallen_m: float = _amplitude('reverse below this (0: 0.7 of the amplitude at the fold)')
    rate_mps2: float = _rate(0.1)

    def begin_mps(self, motion: Motion) -> float:
        """Return the lowest speed: the see-saw begins with a quiet wheelset."""
        return self._by(motion, 0)[0]

    def missing(self, motion: Motion) -> str:
        """Name the keys that have to be given where no form gives them."""
        names = [
            name
            for name, source in _FROM_FORM.items()
            if not getattr(self, name) and math.isnan(getattr(motion, source))
        ]
        if not names:
            return ''
        return f'no normal form with v_n and v_c is in force: give {", ".join(names)}'

    def legs(self, scene: Scene) -> Iterator[Leg]:
        """Iterate over the legs, by the form that is in force when each begins."""
        lower = 0.0

        def lowest() -> float:
            """Return how low the roller goes, m/s."""
            return max(self._by(scene.motion, 0)[0] - lower, 0.0)

        def over(motion: Motion | None = None) -> bool:
            """Return True once the time of the step is up."""
            return scene.elapsed_s >= self.duration_s

        for number in itertools.count():
            _, high, watched, grown, fallen = self._by(scene.motion, number)
            yield Leg(high, self.rate_mps2, _LONGEST_S, above_m=grown, until=over)
            # A form with too high a v_n would leave the rig on the limit cycle.
            died_out = False
            while not (died_out or over()):
                yield Leg(lowest(), self.rate_mps2, self.watch_s, below_m=fallen, until=over)
                died_out = scene.motion.amplitude_m < fallen
                lower += 0.0 if died_out else _LOWER_MPS
            if not over():
                yield Leg(watched, self.rate_mps2, self.watch_s, until=over)
            if over():
                break
        yield Leg(lowest(), self.rate_mps2)

    def _by(self, motion: Motion, number: int) -> tuple[float, float, float, float, float]:
        """Return lowest, highest and watched speed, m/s, and the two triggers, m."""
        v_n, v_c, fold = motion.v_n, motion.v_c, motion.fold_amplitude_m
        low = self.low_mps or v_n - 0.1
        high = self.high_mps or v_c + 0.4
        first = self.watch_low_mps or v_n + _WATCHED[0] * (v_c - v_n)
        last = self.watch_high_mps or v_n + _WATCHED[1] * (v_c - v_n)
        share = (_WATCHED[number % len(_WATCHED)] - _WATCHED[0]) / (_WATCHED[1] - _WATCHED[0])
        grown, fallen = self.grown_m or _GROWN * fold, self.fallen_m or _FALLEN * fold
        return low, high, first + share * (last - first), grown, fallen

    def plan(self) -> list[Leg]:
        """Return what is known without a form: the speeds that are given, and the time."""
        speeds = (self.low_mps, self.high_mps, self.watch_low_mps, self.watch_high_mps)
        return [Leg(speed) for speed in speeds if speed] + [
            Leg(self.low_mps or math.nan, hold_s=self.duration_s)
        ]

    @property
    def reacts(self) -> bool:
        """The detector triggers the reversals."""
        return True


@dataclass(frozen=True)
class Corners(Step):
    """Straight lines between corners, counted from the beginning of the step."""

    times_s: tuple[float, ...] = setting((), 'of the corners, the first 0', unit='s', low=0.0)
    speeds_mps: tuple[float, ...] = setting((), 'speeds there', unit='m/s', low=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.times_s) != len(self.speeds_mps) or not self.times_s:
            raise ConfigError(f'{len(self.times_s)} times for {len(self.speeds_mps)} speeds')
        if self.times_s[0] != 0.0:
            raise ConfigError(f'times_s: must begin at 0 s, got {self.times_s[0]:g}')
        for before, after in itertools.pairwise(self.times_s):
            if not after > before:
                raise ConfigError(f'times_s: {after:g} s comes after {before:g} s')

    def legs(self, scene: Scene) -> Iterator[Leg]:
        """One leg between two corners; the first speed is reached as fast as the drive may."""
        yield Leg(self.speeds_mps[0])
        corners = zip(self.times_s, self.speeds_mps, strict=True)
        for (begin, before), (end, speed) in itertools.pairwise(corners):
            rate = abs(speed - before) / (end - begin)
            yield Leg(speed, rate) if rate else Leg(speed, math.inf, end - begin)


#: Word of the YAML -> step.
STEPS: dict[str, type[Step]] = {
    'hold': Hold,
    'ramp': Ramp,
    'sweep': Sweep,
    'staircase': Staircase,
    'climb': Climb,
    'seesaw': Seesaw,
    'corners': Corners,
}
