"""
The software interlock: from what the detector says, and does not say, to `armed` or `tripped`.

A trip is a control loop: a tripped interlock goes on judging. The roller goes to the speed that
the normal form calls safe, and on through it for as long as the motion is not seen to die, to a
stop if need be.

No clock is read here: stamps are arguments, on a clock that no one can set. It is no safety
function in the sense of any standard; docs/interlock.md says what it is for.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from statistics import median
from typing import NamedTuple

from hunt_ros.dynamics.profile import Motion
from hunt_ros.rig import of_rig
from hunt_ros.samples import NANOSECONDS
from hunt_ros.settings import Settings, setting

#: The detector answers, but no row has been added for so long: it waits at most
#: `sensor_timeout_s` (0.3 s) for a silent sensor, and rows come at `output_rate_hz`.
_STALLED_S = 1.0
#: Statuses that fall behind by so much are those of another moment, s.
_LATE_S = 0.5
#: Stamps that fall back by more than this between two statuses are those of another clock, s.
_CLOCK_STEP_S = 0.4
#: A lag that grows more slowly than `_LATE_S` in this time is drift of the clocks, s.
_DRIFT_S = 30.0
#: A start, in which every process loads its libraries, is over when all has been well for so
#: long without a break, s, ten times what a silence may last; or ill, since it was well first.
_SETTLED_S = 3.0
#: Motion is seen to die below this share of its median over so many statuses, 20 a second: it
#: falls by 0.36 1/s. A limit cycle that follows the falling speed shrinks by less, and neither a
#: kick nor a spike of an estimate is long enough to count.
_DIES, _STATUSES = 0.7, 40
#: What is larger than so many quiet motions is none, though a detector that cannot trust its
#: inputs does not say what it is; and what was seen to move moves until it is no larger.
_QUIET = 3.0
#: What is as large as the smallest limit cycle of the form, and not decided for so many of its
#: periods, trips as hunting does. A kick that dies is known for one after 3.7 at most; a limit
#: cycle that was there at the start, or comes in the first seconds, only after 6 to 20.
_UNDECIDED = 4.0
#: The set point leads the roller by so much on its way down from a refuted safe speed, m/s.
_LEAD_MPS = 0.5

#: Who looks later than this after the look before was held up itself, s: what it did not hear
#: meanwhile may be waiting, or the machine stood still. For no longer than a silence may last.
_LOOKS_S = 0.1

#: Who calls a service need not say who that is.
_SOMEBODY = 'a person'
#: Codes (see `alarms`) of what makes it blind, and of what shows that the wheelset moves.
BLIND, _SEEN = ('detector', 'inputs', 'drive'), ('displacement', 'amplitude', 'hunting')


@dataclass(frozen=True)
class InterlockSettings(Settings):
    """What trips the interlock; the speed node declares its parameters from these fields."""

    interlock: str = setting(
        'protect',
        'protect: also hunting trips it; measure: only what makes the detector blind, the drive,'
        ' and the amplitude limit; off: nothing.',
        choices=('protect', 'measure', 'off'),
    )
    #: Six statuses in a row: three of them a busy machine swallows. Hunting needs 0.35 s for one
    #: period at 2.84 Hz; up to v_c it grows by less than 0.64 1/s, by a fifth in this time.
    status_timeout_s: float = setting(
        0.3,
        'A detector that is silent for longer trips the interlock; its status comes every 0.05 s.',
        unit='s',
        low=0.06,
        high=60.0,
    )
    amplitude_limit_m: float = setting(
        math.inf,
        'A larger amplitude, estimated or of the lateral sensor itself, trips the interlock in'
        ' protect and measure (.inf: flange_clearance_m).',
        unit='m',
        low=1e-6,
    )
    flange_clearance_m: float = of_rig('flange_clearance_m')
    safe_speed_mps: float = of_rig('safe_speed_mps')
    safe_margin_mps: float = setting(
        0.5, 'The safe speed is so far below v_n.', unit='m/s', low=0.0, high=100.0
    )

    @property
    def limit_m(self) -> float:
        """Largest amplitude and displacement, m; inf: none."""
        if math.isfinite(self.amplitude_limit_m):
            return self.amplitude_limit_m
        return self.flange_clearance_m or math.inf


@dataclass(frozen=True)
class Heard:
    """
    What a status of the detector says.

    Parameters
    ----------
    level : str
        OK, WARN, ERROR or STALE.
    sequence : int
        Number of rows so far.
    stamp_ns : int
        Of the row, on the clock of the samples; 0 before the first.
    words : str
        Why the level is what it is.
    envelope_m : float
        The second estimate of the amplitude; NaN: unknown.
    motion : Motion
        Amplitude, critical speeds.
    alarm : bool
        Its alarm is latched: nobody has acknowledged it.
    hunts : bool
        It hunts or escapes, as far as is known: also where the level is STALE.
    quiet_m : float
        Amplitude of the quiet motion; NaN: not known.
    undecided : bool
        It cannot say yet whether the motion is more than noise.
    frequency_hz : float
        Of the motion; NaN: not known.
    """

    level: str = 'STALE'
    sequence: int = 0
    stamp_ns: int = 0
    words: str = ''
    envelope_m: float = math.nan
    motion: Motion = field(default_factory=Motion)
    alarm: bool = False
    hunts: bool = False
    quiet_m: float = math.nan
    undecided: bool = False
    frequency_hz: float = math.nan

    @property
    def largest_m(self) -> float:
        """The larger of the two estimates of the amplitude, m; NaN where neither is known."""
        estimates = (self.motion.amplitude_m, self.envelope_m)
        return max((each for each in estimates if not math.isnan(each)), default=math.nan)


class Change(NamedTuple):
    """
    A transition of the interlock.

    Parameters
    ----------
    event : str
        interlock_tripped, interlock_armed or interlock_disarmed.
    cause : str
        A sentence.
    since_ns : int
        When what caused it began, steady clock.
    """

    event: str
    cause: str
    since_ns: int


class Trouble(NamedTuple):
    """
    What would trip the interlock; one without words is none.

    `code` is one of `alarms.TRIPS`; `since_ns` when it began, steady clock.
    """

    code: str = ''
    words: str = ''
    since_ns: int = 0


class Interlock:
    """
    Watches the detector, the drive and the lateral sensor; trips, and slows the roller down.

    What is seen trips it at once: hunting, in protect, a displacement above the limit, and a
    roller that does what nobody told it. What is not seen trips it once all has been well for
    3 s, or ill for 3 s since it was well first, because what was never there cannot fail: a
    detector that starts later than the drive is no fault. Armed again by a person, it is awake
    at once.

    Parameters
    ----------
    settings : InterlockSettings
    real_time : bool
        False where stamps run at another pace than the clock: their lag is not judged.

    Attributes
    ----------
    state : str
        armed, tripped or disarmed.
    cause, code : str
        Why it is so; the code of what tripped it, '' where nothing has.
    heard : Heard
        What the detector said last.
    goal_mps : float
        While tripped: no faster than this; inf otherwise.
    lost, fault : str
        What is wrong with the drive, and what its roller does that nobody told it; '' where
        nothing. Set them as they come.
    displacement_m : float
        Of the lateral sensor itself; NaN: not known. Set it as it comes.
    parked : bool
        The roller stands, and is to: nothing hunts, nothing can be slowed down, and nothing trips
        it but the roller itself. Set it as it comes.
    moving : bool
        Hunting was seen, or what is as large, and its end was not.
    """

    def __init__(self, settings: InterlockSettings, real_time: bool = True) -> None:
        self.settings = settings
        self._real_time = real_time
        self.heard = Heard()
        self._heard_ns: int | None = None
        self._moved_ns = 0  # when `sequence` changed last
        self._late_s = 0.0
        self.lost, self.fault = 'the drive has not sent anything yet', ''
        self.displacement_m = math.nan
        self.parked = False
        self._watching = False
        self._unwell_ns = 0  # when all was not well last, before it watched
        self._ill_ns = -1  # for how long it was not, since all was well first; -1: it never was
        self._judged_ns = self._held_up_ns = 0  # the last look; lateness of looks since it heard
        self.moving = False
        #: When it was known what the motion is, or that it is small; or the first status.
        self._decided_ns = 0
        self._amplitudes: deque[float] = deque(maxlen=_STATUSES)
        self._told = False  # that the motion goes on at the safe speed
        self.goal_mps = math.inf
        off = settings.interlock == 'off'
        self.state = 'disarmed' if off else 'armed'
        self.cause = 'the parameter interlock is off' if off else 'since the start'
        self.code = ''

    def hear(self, now_ns: int, heard: Heard) -> None:
        """Take a status that has just come."""
        if self._heard_ns is not None and self.heard.stamp_ns and heard.stamp_ns:
            passed_s = (now_ns - self._heard_ns) / NANOSECONDS
            behind_s = passed_s - (heard.stamp_ns - self.heard.stamp_ns) / NANOSECONDS
            if behind_s < _CLOCK_STEP_S:  # what jumps ahead is late no more
                kept = self._late_s * math.exp(-passed_s / _DRIFT_S)
                self._late_s = max(0.0, kept + behind_s)
        if self._heard_ns is None or heard.sequence != self.heard.sequence:
            self._moved_ns = now_ns
        self._decided_ns = self._decided_ns or now_ns
        # At another speed the quiet motion has to be learnt anew: until then it is that of before,
        # and none that is learnt while it moves is larger.
        before_m = self.heard.quiet_m
        if math.isnan(heard.quiet_m) or (self.moving and heard.quiet_m > before_m):
            heard = replace(heard, quiet_m=before_m)
        self.heard, self._heard_ns, self._held_up_ns = heard, now_ns, 0
        amplitude_m = heard.largest_m
        if not (heard.undecided and amplitude_m > heard.motion.fold_amplitude_m):
            self._decided_ns = now_ns
        if not math.isnan(amplitude_m):
            self._amplitudes.append(amplitude_m)

    def motion(self, now_ns: int) -> Motion:
        """Return what the detector sees; of one that is silent the form in force alone."""
        motion = self.heard.motion
        return Motion().with_form(motion) if self._silence(now_ns) else motion

    def trouble(self, now_ns: int) -> Trouble:
        """Return what would trip the interlock now (steady clock), the gravest first."""
        mode = self.settings.interlock
        for found in self._troubles(now_ns) if mode != 'off' else ():
            if found.code != 'hunting' or mode == 'protect':
                return found
        return Trouble()

    def _troubles(self, now_ns: int) -> Iterator[Trouble]:
        """Yield what is wrong, whatever the mode, the gravest first."""
        heard, limit_m = self.heard, self.settings.limit_m
        amplitude_m = heard.largest_m
        above = f'above the limit, {1e3 * limit_m:.3f} mm'
        if self.fault:
            yield Trouble('speed', self.fault, now_ns)
        if self.displacement_m > limit_m:
            words = f'displacement {1e3 * self.displacement_m:.3f} mm {above}'
            yield Trouble('displacement', words, now_ns)
        if silence := self._silence(now_ns):
            yield Trouble('detector', silence, self._heard_ns or now_ns)
        if heard.level == 'STALE':
            words = f'the detector cannot trust its inputs: {heard.words}'
            yield Trouble('inputs', words, now_ns)
        if self.lost:
            yield Trouble('drive', self.lost, now_ns)
        if amplitude_m > limit_m:
            yield Trouble('amplitude', f'amplitude {1e3 * amplitude_m:.3f} mm {above}', now_ns)
        if heard.level == 'ERROR' or heard.hunts:
            yield Trouble('hunting', f'the detector says {heard.level}: {heard.words}', now_ns)
        undecided_s = ((self._heard_ns or 0) - self._decided_ns) / NANOSECONDS
        if undecided_s * heard.frequency_hz > _UNDECIDED:
            size = f'{1e3 * amplitude_m:.3f} mm, as much as a limit cycle,'
            words = f'not known for {undecided_s:.1f} s whether {size} is hunting'
            yield Trouble('hunting', words, self._decided_ns)

    def _silence(self, now_ns: int) -> str:
        """Return how the detector is not to be heard; '' where it is."""
        if self._heard_ns is None:
            return 'the detector has not been heard yet'
        limit = self.settings.status_timeout_s
        held_up_s = min(self._held_up_ns / NANOSECONDS, limit)
        silent_s = (now_ns - self._heard_ns) / NANOSECONDS - held_up_s
        stalled_s = (now_ns - self._moved_ns) / NANOSECONDS - held_up_s
        if silent_s > limit:
            return f'the detector is silent for {silent_s:.2f} s, more than {limit:g} s'
        if stalled_s > max(_STALLED_S, limit):
            return f'the detector has judged nothing new for {stalled_s:.1f} s'
        if self._real_time and self._late_s > max(_LATE_S, limit):
            return f'what the detector says comes {self._late_s:.1f} s late'
        return ''

    def judge(self, now_ns: int, speed_mps: float = math.nan) -> Change | None:
        """
        Trip where there is a reason to, and go lower where that does not help.

        Parameters
        ----------
        now_ns : int
            Steady clock; to be called again and again.
        speed_mps : float
            Of the roller; NaN: not known.
        """
        before_ns, self._judged_ns = self._judged_ns, now_ns
        self._held_up_ns += max(0, now_ns - before_ns - round(_LOOKS_S * NANOSECONDS))
        trouble, troubles = self.trouble(now_ns), list(self._troubles(now_ns))
        blind = any(each.code in BLIND for each in troubles)
        seen = next((each.words for each in troubles if each.code in _SEEN), '')
        amplitude_m = self.heard.largest_m
        if blind and amplitude_m > _QUIET * self.heard.quiet_m:
            seen = seen or f'the amplitude was {1e3 * amplitude_m:.3f} mm at last'
        # What was seen lasts until its end is seen. Silence is none, nor is what a detector says
        # of the motion: a wrong form calls a limit cycle dying, and one that has just come back
        # has not decided yet.
        ended = not blind and amplitude_m <= _QUIET * self.heard.quiet_m
        self.moving = bool(seen) or (self.moving and not ended)
        # A detector that is blind sees nothing die.
        before_m = median(self._amplitudes) if self._amplitudes else math.nan
        lasts = self.moving and (blind or not amplitude_m < _DIES * before_m)
        if self.state == 'tripped':
            return self._slow_down(now_ns, speed_mps, trouble.code, seen, lasts)
        if self.state != 'armed':
            return None
        trips = self._watching or trouble.code not in BLIND
        if trouble.words and trips and (trouble.code == 'speed' or not self.parked):
            self.goal_mps = self.safe_speed_mps()
            change = self._to('tripped', trouble.words, trouble.since_ns)
            self.code = trouble.code
            self._told = False
            self._slow_down(now_ns, speed_mps, trouble.code, seen, lasts)
            return change
        if trouble.words:
            self.cause = f'waits until all is well: {trouble.words}'
            self._unwell_ns = now_ns
            if self._ill_ns >= 0:  # a profile may have begun when all was well
                self._ill_ns += now_ns - before_ns
                self._watching |= self._ill_ns >= _SETTLED_S * NANOSECONDS
            return None
        self._ill_ns = max(self._ill_ns, 0)
        if not self._watching and now_ns - self._unwell_ns >= _SETTLED_S * NANOSECONDS:
            self._watching, self.cause = True, 'no reason to trip'
        return None

    def _slow_down(
        self, now_ns: int, speed_mps: float, code: str, seen: str, lasts: bool
    ) -> Change | None:
        """Lower the goal of a tripped interlock; return that its model is refuted, once."""
        safe_mps = self.safe_speed_mps()
        if not math.isnan(self.heard.motion.v_n):
            self.goal_mps = min(self.goal_mps, safe_mps)
        if code == 'speed':
            self.goal_mps = 0.0  # the only set point that means the same to every scale
        if not lasts:
            return None
        lower_mps = (0.0 if math.isnan(speed_mps) else speed_mps) - _LEAD_MPS
        self.goal_mps = max(0.0, min(self.goal_mps, lower_mps))
        if self._told or not speed_mps <= safe_mps - _LEAD_MPS:
            return None
        self._told = True
        cause = (
            f'the motion has not died out at {safe_mps:.2f} m/s, the safe speed: the roller goes'
            f' lower ({seen or "its end has not been seen"})'
        )
        return self._to('tripped', cause, now_ns)

    def refusal(self, now_ns: int) -> str:
        """Return '' or why no profile may be started or resumed."""
        if self.state == 'tripped':
            return f'the interlock has tripped ({self.cause}): rearm it first (hunt call rearm)'
        words = self.trouble(now_ns).words if self.state == 'armed' else ''
        return f'interlock ({self.settings.interlock}): {words}' if words else ''

    def safe_speed_mps(self) -> float:
        """Return where the roller is to go when it trips, m/s, as far as is known now."""
        v_n, given = self.heard.motion.v_n, self.settings.safe_speed_mps
        if math.isnan(v_n):
            return given if math.isfinite(given) else 0.0
        return min(given, max(0.0, v_n - self.settings.safe_margin_mps))

    def unsafe(self) -> str:
        """Return '' or that the safe speed of the rig is none by the form in force."""
        v_n, given = self.heard.motion.v_n, self.settings.safe_speed_mps
        if not v_n <= given < math.inf:
            return ''
        used = f'v_n, {v_n:.3f} m/s: {self.safe_speed_mps():.2f} m/s is used'
        return f'safe_speed_mps, {given:g} m/s, is not below {used}'

    def rearm(self, now_ns: int, who: str = '') -> tuple[Change | None, str]:
        """Arm a tripped interlock again; return the transition, and '' or why not."""
        if self.state != 'tripped':
            return None, ''
        words = self.trouble(now_ns).words
        if words:
            return None, (
                f'the interlock stays tripped, its cause is not over: {words};'
                ' to go on without it, disarm it (hunt call disarm-interlock)'
            )
        state = 'disarmed' if self.settings.interlock == 'off' else 'armed'
        return self._to(state, f'{state} again by {who or _SOMEBODY}', now_ns), ''

    def arm(self, now_ns: int, armed: bool, who: str = '') -> tuple[Change | None, str]:
        """Arm or disarm; return the transition, and '' or why not."""
        if armed and self.settings.interlock == 'off':
            return None, 'the parameter interlock is off: set it to protect or measure first'
        if armed and self.state == 'tripped':
            return None, 'the interlock has tripped: rearm it (hunt call rearm)'
        if armed == (self.state != 'disarmed'):
            return None, ''
        if armed:
            return self._to('armed', f'armed by {who or _SOMEBODY}', now_ns), ''
        words = f'disarmed by {who or _SOMEBODY}: nothing slows the roller'
        return self._to('disarmed', words, now_ns), ''

    def reconfigure(self, now_ns: int, settings: InterlockSettings) -> Change | None:
        """Use other settings; the mode `off` disarms, and leaving it arms."""
        before, self.settings = self.settings.interlock, settings
        mode = settings.interlock
        if mode == before or 'off' not in (mode, before):
            return None
        words = f'the parameter interlock is {mode} now'
        return self._to('disarmed' if mode == 'off' else 'armed', words, now_ns)

    def restore(self, state: str, cause: str, goal_mps: float) -> None:
        """Be tripped or disarmed again, as before the process ended."""
        self._to(state, cause, 0)
        self.goal_mps = goal_mps if state == 'tripped' else math.inf

    def _to(self, state: str, cause: str, since_ns: int) -> Change:
        if state != 'tripped':
            self.goal_mps, self.code = math.inf, ''
        self.state, self.cause = state, cause
        self._watching = state == 'armed'
        return Change(f'interlock_{state}', cause, since_ns)
