"""
The software interlock: from what the detector says, and does not say, to `armed` or `tripped`.

No clock is read here: stamps are arguments, on a clock that no one can set. It is no safety
function in the sense of any standard; docs and README say what it is for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from hunt_ros.dynamics.profile import Motion
from hunt_ros.rig import of_rig
from hunt_ros.samples import NANOSECONDS
from hunt_ros.settings import Settings, setting

#: The detector answers, but no row has been added for so long: it waits at most
#: `sensor_timeout_s` (0.2 s) for a silent sensor, and rows come at `output_rate_hz`.
_STALLED_S = 1.0
#: Statuses that fall behind by so much are those of another moment, s.
_LATE_S = 0.5
#: Stamps that fall back by more than this between two statuses are those of another clock, s.
_CLOCK_STEP_S = 0.4
#: A lag that grows more slowly than `_LATE_S` in this time is drift of the clocks, s.
_DRIFT_S = 30.0


@dataclass(frozen=True)
class InterlockSettings(Settings):
    """What trips the interlock; the speed node declares its parameters from these fields."""

    interlock: str = setting(
        'protect',
        'protect: also hunting trips it; measure: only what makes the detector blind, and the'
        ' amplitude limit; off: nothing.',
        choices=('protect', 'measure', 'off'),
    )
    status_timeout_s: float = setting(
        0.15,
        'A detector that is silent for longer trips the interlock; its status comes every 0.05 s.',
        unit='s',
        low=0.06,
        high=60.0,
    )
    amplitude_limit_m: float = setting(
        0.0,
        'A larger amplitude trips the interlock in protect and measure (0: flange_clearance_m).',
        unit='m',
        low=0.0,
        high=1.0,
    )
    flange_clearance_m: float = of_rig('flange_clearance_m')
    safe_speed_mps: float = of_rig('safe_speed_mps')
    safe_margin_mps: float = setting(
        0.5, 'The safe speed is so far below v_n.', unit='m/s', low=0.0, high=100.0
    )


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
    """

    level: str = 'STALE'
    sequence: int = 0
    stamp_ns: int = 0
    words: str = ''
    envelope_m: float = math.nan
    motion: Motion = field(default_factory=Motion)


@dataclass(frozen=True)
class Change:
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


class Interlock:
    """
    Watches the detector, and trips once.

    What is seen trips it at once: hunting, in protect, and an amplitude above the limit. What
    is not seen trips it from the moment on when all has been well for the first time, because
    what was never there cannot fail: a detector that starts later than the drive is no fault.

    Parameters
    ----------
    settings : InterlockSettings
    real_time : bool
        False where stamps run at another pace than the clock: their lag is not judged.

    Attributes
    ----------
    state : str
        armed, tripped or disarmed.
    cause : str
        Why it is so.
    heard : Heard
        What the detector said last.
    """

    def __init__(self, settings: InterlockSettings, real_time: bool = True) -> None:
        self.settings = settings
        self._real_time = real_time
        self.heard = Heard()
        self._heard_ns: int | None = None
        self._moved_ns = 0  # when `sequence` changed last
        self._late_s = 0.0
        self._drive = 'the drive has not sent anything yet'
        self._watching = False
        off = settings.interlock == 'off'
        self.state = 'disarmed' if off else 'armed'
        self.cause = 'the parameter interlock is off' if off else 'since the start'

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
        self.heard, self._heard_ns = heard, now_ns

    def drive(self, lost: str) -> None:
        """Take note of the drive: '' where it answers, or what is wrong with it."""
        self._drive = lost

    def motion(self, now_ns: int) -> Motion:
        """Return what the detector sees; nothing where it is silent."""
        return Motion() if self._silence(now_ns) else self.heard.motion

    def trouble(self, now_ns: int) -> tuple[str, int]:
        """
        Return what would trip the interlock now, and since when; '' where all is well.

        Parameters
        ----------
        now_ns : int
            Steady clock.
        """
        if self.settings.interlock == 'off':
            return '', now_ns
        blind, since_ns = self._blind(now_ns)
        return (blind, since_ns) if blind else (self._seen(), now_ns)

    def _blind(self, now_ns: int) -> tuple[str, int]:
        """Return why the motion cannot be judged, and since when; '' where it can."""
        if silence := self._silence(now_ns):
            return silence, self._heard_ns or now_ns
        if self.heard.level == 'STALE':
            return f'the detector cannot trust its inputs: {self.heard.words}', now_ns
        return self._drive, now_ns

    def _seen(self) -> str:
        """Return what is wrong with the motion; '' where nothing is."""
        settings, heard = self.settings, self.heard
        limit = settings.amplitude_limit_m or settings.flange_clearance_m or math.inf
        known = (x for x in (heard.motion.amplitude_m, heard.envelope_m) if not math.isnan(x))
        largest = max(known, default=0.0)
        if largest > limit:
            return f'amplitude {1e3 * largest:.3f} mm above the limit, {1e3 * limit:.3f} mm'
        if heard.level == 'ERROR' and settings.interlock == 'protect':
            return f'the detector says ERROR: {heard.words}'
        return ''

    def _silence(self, now_ns: int) -> str:
        """Return '' or how the detector is not to be heard."""
        if self._heard_ns is None:
            return 'the detector has not been heard yet'
        silent_s = (now_ns - self._heard_ns) / NANOSECONDS
        if silent_s > self.settings.status_timeout_s:
            limit = self.settings.status_timeout_s
            return f'the detector is silent for {silent_s:.2f} s, more than {limit:g} s'
        stalled_s = (now_ns - self._moved_ns) / NANOSECONDS
        if stalled_s > max(_STALLED_S, self.settings.status_timeout_s):
            return f'the detector has judged nothing new for {stalled_s:.1f} s'
        if self._real_time and self._late_s > max(_LATE_S, self.settings.status_timeout_s):
            return f'what the detector says comes {self._late_s:.1f} s late'
        return ''

    def judge(self, now_ns: int) -> Change | None:
        """Trip where there is a reason to; to be called again and again."""
        if self.state != 'armed':
            return None
        trouble, since_ns = self.trouble(now_ns)
        blind, _ = self._blind(now_ns)
        if trouble and (self._watching or not blind):
            return self._to('tripped', trouble, since_ns)
        if trouble:
            self.cause = f'waits until all is well: {trouble}'
        elif not self._watching:
            self._watching, self.cause = True, 'no reason to trip'
        return None

    def refusal(self, now_ns: int) -> str:
        """Return '' or why no profile may be started or resumed."""
        if self.state == 'tripped':
            return f'the interlock has tripped ({self.cause}): call speed/rearm first'
        trouble, _ = self.trouble(now_ns) if self.state == 'armed' else ('', 0)
        return f'interlock ({self.settings.interlock}): {trouble}' if trouble else ''

    def safe_speed_mps(self) -> float:
        """Return where the roller is to go when it trips, m/s, as far as is known now."""
        if self.settings.safe_speed_mps:
            return self.settings.safe_speed_mps
        v_n = self.heard.motion.v_n
        return 0.0 if math.isnan(v_n) else max(0.0, v_n - self.settings.safe_margin_mps)

    def rearm(self, now_ns: int) -> tuple[Change | None, str]:
        """Arm a tripped interlock again; return the transition, and '' or why not."""
        if self.state != 'tripped':
            return None, ''
        trouble, _ = self.trouble(now_ns)
        if trouble:
            return None, (
                f'the interlock stays tripped, its cause is not over: {trouble};'
                ' to go on without it, disarm it (speed/arm_interlock false)'
            )
        return self._to('armed', 'armed again by a person', now_ns), ''

    def arm(self, now_ns: int, armed: bool) -> tuple[Change | None, str]:
        """Arm or disarm; return the transition, and '' or why not."""
        if armed and self.settings.interlock == 'off':
            return None, 'the parameter interlock is off: set it to protect or measure first'
        if armed and self.state == 'tripped':
            return None, 'the interlock has tripped: call speed/rearm'
        if armed == (self.state != 'disarmed'):
            return None, ''
        if armed:
            return self._to('armed', 'armed by a person', now_ns), ''
        return self._to('disarmed', 'disarmed by a person: nothing slows the roller', now_ns), ''

    def reconfigure(self, now_ns: int, settings: InterlockSettings) -> Change | None:
        """Use other settings; the mode `off` disarms, and leaving it arms."""
        before, self.settings = self.settings, settings
        if settings.interlock == before.interlock:
            return None
        words = f'the parameter interlock is {settings.interlock} now'
        if settings.interlock == 'off':
            return self._to('disarmed', words, now_ns)
        return self._to('armed', words, now_ns) if before.interlock == 'off' else None

    def _to(self, state: str, cause: str, since_ns: int) -> Change:
        self.state, self.cause = state, cause
        self._watching = state == 'armed'
        return Change(f'interlock_{state}', cause, since_ns)
