"""Why the level is what it is, and why something changed, in words for an operator."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hunt_ros.detection import doubts, health
from hunt_ros.detection.configuration import DetectorConfig
from hunt_ros.detection.decision import states
from hunt_ros.detection.decision.decisions import MARGIN_RESTORE_S
from hunt_ros.detection.decision.limits import LIMITS, limit_cause
from hunt_ros.detection.regions import Region, State
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.samples import CHANNELS, Uncertain

#: A shorter time to the limit cycle is not told: it is there, as far as one can tell, s.
_SOON_S = 0.1
#: Less than this, in mm or mrad, is told in um or urad, from this on in m or rad.
_FINEST, _LARGEST = 1e-3, 1e3


class Basis(NamedTuple):
    """
    What the numbers of a row were compared with; v_n and v_c, m/s, NaN: none, unknown.

    `decided` is why the state was said, with the numbers there were then.
    """

    config: DetectorConfig
    v_n: float = math.nan
    v_c: float = math.nan
    form: IdentifiedNormalForm | None = None
    decided: str = ''

    @property
    def normal_form(self) -> str:
        """The form by its critical speeds; '' where there is none."""
        return '' if self.form is None else self.form.words

    @property
    def fold_amplitude(self) -> float:
        """Of the limit cycle at v_n, m; NaN where no form gives it."""
        fold = None if self.form is None else self.form.form.saddle_node()
        return math.nan if fold is None else fold[1]


class Reason(NamedTuple):
    """
    What makes a row WARN or worse: a line of the table `REASONS`.

    Parameters
    ----------
    column, bit : str, int
        Where a row says so; of the column `state` each state has a bit.
    words : str
        For an operator.
    numbers : callable, optional
        What gives the numbers of a row.
    code : str
        Code of an alarm (docs/alarm.md); '' where it makes no row ERROR or STALE.
    """

    column: str
    bit: int
    words: str
    numbers: Callable[[np.void, Basis], str] | None = None
    code: str = ''

    def among(self, row: np.void) -> bool:
        """Whether it is a reason in a row (ESTIMATE_DTYPE)."""
        return bool(_bits(row, self.column) & self.bit)


def _bits(rows: Any, column: str) -> Any:
    """Return the bits in a column of rows (ESTIMATE_DTYPE), or of one."""
    return 1 << rows[column].astype(np.uint32) if column == 'state' else rows[column]


def reasons_of(row: np.void, basis: Basis) -> tuple[str, ...]:
    """Put a row (ESTIMATE_DTYPE) into words, the most serious first; empty where all is well."""
    found = []
    for _, _, words, numbers, _ in filter(lambda reason: reason.among(row), REASONS):
        between = '' if numbers is _lasting else ': '
        found.append(words if numbers is None else f'{words}{between}{numbers(row, basis)}')
    return tuple(found)


def causes_of(row: np.void) -> list[str]:
    """Return the codes of what makes a row ERROR or STALE: of the motion, then of channels."""
    found = [each for each in REASONS if each.code and each.among(row)]
    return [each.code for each in sorted(found, key=lambda each: each.column.endswith('_wrong'))]


def reason_counts(rows: NDArray[np.void]) -> Counter[str]:
    """Count the rows (ESTIMATE_DTYPE) that each reason made WARN or worse, without numbers."""
    bits = {column: _bits(rows, column) for column in {each.column for each in REASONS}}
    seen = {column: np.bitwise_or.reduce(found) for column, found in bits.items()}
    there = [each for each in REASONS if seen[each.column] & each.bit]
    return Counter(
        {each.words: int(np.count_nonzero(bits[each.column] & each.bit)) for each in there}
    )


def absent_words(row: np.void) -> tuple[str, ...]:
    """Return which optional channels are absent in a row, and what that costs."""
    gone = [name for name in CHANNELS if int(row[f'{name}_wrong']) & health.ABSENT]
    return tuple(f'{name} is absent: {health.COSTS[name]}' for name in gone)


def _lasting(row: np.void, basis: Basis) -> str:
    """Say how long the state has lasted, why it was said, and what is ahead."""
    told, time = '', float(row['time_to_limit_cycle'])
    if basis.decided:
        lasted = 1e-9 * (int(row['stamp_ns']) - int(row['state_since_ns']))
        # Where a clock was set back, the state began on the one before. The numbers are those of
        # the decision, which the ones beside them have left behind since.
        told = (f' for {lasted:.1f} s' if lasted >= 0.0 else '') + f', at first: {basis.decided}'
    soon = row['state'] == State.ESCAPING and time >= _SOON_S
    return told + (f', limit cycle in about {time:.1f} s' if soon else '')


def _number(row: np.void, name: str, unit: str, scale: float = 1.0) -> str:
    """Return a number of a row, with its deviation where it has one, and its unit."""
    value, std = scale * float(row[name]), math.nan
    if f'{name}_std' in (row.dtype.names or ()):
        std = scale * float(row[f'{name}_std'])
    if math.isnan(value):
        return 'unknown'
    size = math.fabs(value)
    if unit[0] == 'm' and 0.0 < size < _FINEST:
        value, std, unit = 1e3 * value, 1e3 * std, f'u{unit[1:]}'
    elif unit[0] == 'm' and size >= _LARGEST:
        value, std, unit = 1e-3 * value, 1e-3 * std, unit[1:]
    return f'{Uncertain(value, std).text(" +/- ") if std > 0.0 else f"{value:.3g}"} {unit}'


def _judged(row: np.void) -> tuple[str, str]:
    """Return the coordinate that is judged, and the unit in which it is told."""
    only = math.isnan(row['lateral_amplitude']) and math.isfinite(row['yaw_amplitude'])
    in_yaw = only or int(row['doubts']) & doubts.IN_YAW
    return ('yaw', 'mrad') if in_yaw else ('lateral', 'mm')


def _size(row: np.void) -> str:
    """Return the amplitude that is judged; beside it that of lateral, where yaw told it."""
    name, unit = _judged(row)
    own = _number(row, f'{name}_amplitude', unit, 1e3)
    if math.isnan(row['judged']) or row['judged'] == row[f'{name}_amplitude']:
        return f'amplitude {own}'
    return f'amplitude {_number(row, "judged", unit, 1e3)} by yaw (lateral shows {own})'


def _unstable(row: np.void) -> str:
    return f'unstable amplitude {_number(row, "unstable_amplitude", "mm", 1e3)}'


def state_cause(row: np.void, basis: Basis) -> tuple[str, str]:
    """Return which test led to the state of a row, and its evidence with its numbers."""
    size, growth = f'the {_size(row)}', f'growth rate {_number(row, "growth_rate", "1/s")}'
    floor = f'quiet amplitude {_number(row, "noise_floor", _judged(row)[1], 1e3)}'
    hunts = (
        f'hunting with a probability of {_percent(float(row["hunting_probability"]))}; {growth}'
    )
    value, low, high = (
        f'{100.0 * float(row[f"escape_probability{end}"]):.0f}' for end in ('', '_low', '_high')
    )
    chance = f'{size} ends on the limit cycle with a probability of {value} %'
    chance += f' ({low} to {high} %)' if low != high else ''
    edge = ''
    if math.isfinite(row['unstable_amplitude']):
        edge = f', {_unstable(row)}'
    elif int(row['region']) == Region.UNSTABLE and not int(row['doubts']) & doubts.IN_YAW:
        edge = ', the quiet state is unstable at this speed'
    cycle = _number(row, 'stable_amplitude', 'mm', 1e3)
    of_it = f' of {cycle}' if math.isfinite(row['stable_amplitude']) else ''
    least = f', limit {100.0 * basis.config.escape_probability_in:g} %'
    words = {
        states.BEYOND: ('escape_probability', f'{chance}{least}{edge}; {growth}'),
        states.ARRIVED: (
            'stable_amplitude',
            f'{size} has reached the limit cycle{of_it}{edge}; {growth}',
        ),
        states.STEADY: (
            'hunting_probability',
            f'{size} stays as that of a limit cycle does: {hunts}, {floor}',
        ),
        states.GROWING: ('hunting_probability', f'{size} grows: {hunts}, {floor}'),
        states.COMES_BACK: ('escape_probability', f'{chance} only{edge}; {growth}'),
        states.FALLS: ('hunting_probability', f'{size} falls: {hunts}{edge}'),
        states.OVER: ('noise_floor', f'{size} is that of the quiet motion again: {floor}'),
    }
    return words.get(int(row['state_cause']), ('amplitude', size))


def _percent(chance: float) -> str:
    """Return a probability in per cent, with the digits that tell it from 0 and 1."""
    if math.isnan(chance):
        return 'that is not known'
    least = min(chance, 1.0 - chance)
    digits = 0 if least >= 0.01 else min(math.ceil(-math.log10(max(least, 1e-9))) - 2, 3)
    return f'{100.0 * chance:.{digits}f} %'


def region_cause(row: np.void, basis: Basis) -> str:
    """Say where the speed of a row lies."""
    v_n, v_c, speed = basis.v_n, basis.v_c, float(row['speed'])
    if math.isnan(speed):
        return 'the speed is not known'
    fold = f'v_n = {v_n:.3f} m/s' if v_n > 0.0 else 'the fold, which is not known'
    starts = f', {_unstable(row)}' if math.isfinite(row['unstable_amplitude']) else ''
    words = {
        Region.UNKNOWN: 'has no known boundaries',
        Region.STABLE: f'is below {fold if math.isfinite(v_n) else f"v_c = {v_c:.3f} m/s"}',
        Region.HYSTERESIS: f'lies between {fold} and v_c = {v_c:.3f} m/s{starts}',
        Region.UNSTABLE: f'is above v_c = {v_c:.3f} m/s',
    }
    return f'the speed {speed:.3f} m/s ' + words[Region(int(row['region']))]


def margin_cause(row: np.void, basis: Basis) -> str:
    """Compare the margin of a row with its limit."""
    low = bool(int(row['doubts']) & doubts.MARGIN)
    margin = float(row['margin'])
    if not math.isfinite(margin):
        if int(row['region']) == Region.UNSTABLE:
            return 'quiet motion is unstable at this speed'
        gone = 'every motion dies out at this speed'
        hunts = int(row['state']) >= State.ESCAPING
        if not low:
            return gone
        return f'{gone}, this one has not yet' if hunts else f'{gone}, this one only just has'
    least, most = float(row['margin_low']), float(row['margin_high'])
    interval = f'{least:.3g} to {most:.3g}' if math.isfinite(most) else f'at least {least:.3g}'
    found = f'unstable amplitude over amplitude is {margin:.3g} ({interval})'
    limit = f'limit {basis.config.margin_in:g}'
    if low and margin >= basis.config.margin_in:
        restored_s = MARGIN_RESTORE_S / basis.config.faster
        limit += f' to be kept for {restored_s:.3g} s after it was lower'
    edge = _unstable(row)
    if math.isnan(row['unstable_amplitude']):
        edge = 'unstable amplitude by those of the laws that have one at this speed'
    return f'{found}, {limit}; {edge}, {_size(row)}'


def outside_words(row: np.void, _: Basis | None = None) -> str:
    """Say of a row with motion that is not followed what it is, and what to do."""
    lateral, yaw = 1e3 * float(row['outside_lateral']), 1e3 * float(row['outside_yaw'])
    motion = f'motion of {lateral:.2g} mm' if lateral > 0.0 else f'yaw motion of {yaw:.2g} mrad'
    low, high = float(row['followed_min_hz']), float(row['followed_max_hz'])
    hz = float(row['outside_hz'])
    where = f'lies outside the hunting frequencies {low:.3g} to {high:.3g} Hz that are followed'
    if low <= hz <= high:
        where = f'is not what the filter follows at {float(row["frequency_hz"]):.2g} Hz'
    return f'a {motion} at {hz:.2g} Hz {where}: set hunting_frequency_hz if it is hunting'


def _two_amplitudes(row: np.void, _: Basis) -> str:
    """Return both estimates of the amplitude, for each sensor that has both."""
    found = []
    for name, unit in (('lateral', 'mm'), ('yaw', 'mrad')):
        a, envelope = 1e3 * float(row[f'{name}_amplitude']), 1e3 * float(row[f'{name}_envelope'])
        if math.isfinite(a + envelope):
            found.append(f'{name} {a:.3g} and {envelope:.3g} {unit}')
    return ', '.join(found)


def _spread(row: np.void, _: Basis) -> str:
    return f'+/- {100.0 * row["lateral_amplitude_std"] / row["lateral_amplitude"]:.0f} %'


def _two_frequencies(row: np.void, basis: Basis) -> str:
    """Return the frequency of the motion, and that of the hunting by the form."""
    form_hz = math.nan if basis.form is None else basis.form.form.frequency_hz
    smallest = f'{1e3 * basis.fold_amplitude:.3g} mm'
    fold = f', its limit cycles {smallest} and more' if basis.fold_amplitude > 0.0 else ''
    own = f'{_size(row)} at {_number(row, "frequency_hz", "Hz")}'
    return f'{own}; that has {form_hz:.3g} Hz{fold}'


#: What each doubt is called, and what gives its numbers; in the order in which they are told.
_DOUBTS: tuple[tuple[int, str, Callable[[np.void, Basis], str] | None], ...] = (
    (doubts.MARGIN, 'low margin', margin_cause),
    (doubts.DISAGREE, 'filter and Hilbert envelope disagree on the amplitude', _two_amplitudes),
    (doubts.FROM_YAW, 'lateral amplitude is that of yaw through the mode shape', _spread),
    (doubts.OUTSIDE, 'motion that is not followed', outside_words),
    (
        doubts.REFUTED,
        'the normal form has the limit cycle die out at this speed',
        None,
    ),
    (doubts.OTHER, 'steady motion that is not the hunting of the normal form', _two_frequencies),
    (doubts.CONTRARY, 'lateral and yaw sensor contradict each other', None),
    (doubts.ON_LINE, 'hunting cannot be told from a line of the roller at its frequency', None),
    (doubts.NO_ESTIMATE, 'no estimate of the hunting amplitude yet', None),
    (doubts.SETTLING, 'not decided yet whether the motion is more than noise', None),
    (doubts.NO_SPEED, 'region unknown: no speed', None),
    (doubts.NO_FORM, 'region unknown: no normal form and no critical speeds', None),
    (
        doubts.IN_YAW,
        'lateral amplitude unknown: yaw is judged, by what its amplitude does alone',
        None,
    ),
    (doubts.DECAYING, 'hunting is dying out', _lasting),
    (doubts.HYSTERESIS, 'hysteresis region: a disturbance can start hunting', region_cause),
    (doubts.UNSTABLE, 'above the linear critical speed', region_cause),
)
_CHANNELS = [
    Reason(f'{name}_wrong', bit, f'{name}: {words}', None, code and f'{name}_{code}')
    for name in CHANNELS
    for bit, words in health.WORDS.items()
    for code in [health.CODES.get(bit, '')]
]


def _of_limit(number: int) -> Reason:
    setting, severity, what, *_ = LIMITS[number]
    return Reason(
        'limits',
        1 << number,
        f'{what} above its {severity} limit',
        lambda row, basis: limit_cause(row, number, basis.config),
        setting if severity == 'alarm' else '',
    )


#: Every reason, in the order in which they are told.
REASONS: tuple[Reason, ...] = (
    *(each for each in _CHANNELS if each.code),
    Reason('state', 1 << State.ESCAPING, 'escaping from the quiet state', _lasting, 'escaping'),
    Reason('state', 1 << State.LIMIT_CYCLE, 'limit cycle', _lasting, 'limit_cycle'),
    *map(_of_limit, reversed(range(len(LIMITS)))),  # alarms first
    *(Reason('doubts', *doubt) for doubt in _DOUBTS),
    *(each for each in _CHANNELS if not each.code),
)
