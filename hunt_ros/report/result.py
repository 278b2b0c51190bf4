"""
How the report reads an identification: by the public JSON keys, and never past a null.

Everything shown comes from the document that `hunt identify --json` writes, so the
page and the JSON cannot disagree. What is null there is 'not known', and is shown with
the reason that the warnings give for it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hunt_ros.identification.silence import is_silence, reason_in

#: What a warning must speak of to be the reason of a null, by the start of its key. The
#: first that matches counts, so the narrow ones stand first.
_SUBJECTS: tuple[tuple[str, str], ...] = (
    (
        r'(?:.*\.)?(?:std|ci95|amplitude_std_m|maxima_std_m|std_m|ci95_m)$',
        r'interval|bootstrap|uncertain|\bstd\b|runs?\b',
    ),
    (r'observed', r'observed|jump'),
    (r'v_c', r'\bv_c\b|Hopf|linear critical'),
    (r'v_n', r'\bv_n\b|fold|saddle|unstable branch'),
    (r'hysteresis_width', r'hysteresis|width|\bv_n\b|fold|saddle'),
    (r'coefficients\.(?P<name>D\d+)', r'\b{name}\b|coefficient|normal form'),
    (r'coefficients|criticality', r'coefficient|normal form|critical|\bv_c\b|lack of fit'),
    (r'disturbance', r'disturbance|Appendix A'),
    (r'four_point', r'four.point'),
    (r'branches', r'branch|steady state|normal form'),
    (r'fit', r'\bfit|residual|trajector|segment'),
)

_NO_REASON = 'the identification gave no reason'


@dataclass(frozen=True)
class Unknown:
    """A null of the document: where it stands, and why it is not known."""

    path: str
    reason: str


@dataclass(frozen=True)
class Result:
    """
    The document of an identification, read by path.

    Parameters
    ----------
    document : mapping
        As `hunt identify --json` writes it.
    """

    document: Mapping[str, Any]

    def get(self, path: str) -> Any:
        """Return the entry at 'coefficients.D4' or 'branches.3'; None where it is not known."""
        return self._walk(path)[1]

    def has(self, path: str) -> bool:
        """Whether the document has that key at all, known or null."""
        return self._walk(path)[0]

    def _walk(self, path: str) -> tuple[bool, Any]:
        entry: Any = self.document
        for key in path.split('.'):
            if isinstance(entry, Mapping) and key in entry:
                entry = entry[key]
            elif isinstance(entry, list) and key.isdecimal() and int(key) < len(entry):
                entry = entry[int(key)]
            else:
                return False, None
        return True, entry

    def value(self, path: str) -> float | None:
        """Return the number at a path: of a plain number, or the value of an uncertain one."""
        entry = self.get(path)
        if isinstance(entry, Mapping):
            entry = entry.get('value')
        return None if entry is None else float(entry)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings, in their order."""
        return tuple(str(line) for line in self.document.get('warnings') or ())

    @property
    def notices(self) -> tuple[str, ...]:
        """The warnings, without those that only give the reason of a null."""
        return tuple(line for line in self.warnings if not is_silence(line))

    def steady_states(self, direction: str | None = None) -> list[Mapping[str, Any]]:
        """Return the measured steady states, all or of one direction, by speed."""
        entries: Sequence[Mapping[str, Any]] = self.document.get('steady_states') or ()
        chosen = [x for x in entries if direction is None or x.get('direction') == direction]
        return sorted(chosen, key=lambda entry: float(entry['speed_mps']))

    def branches(self) -> list[Mapping[str, Any]]:
        """Return the branches of the model, by speed."""
        entries: Sequence[Mapping[str, Any]] = self.document.get('branches') or ()
        return sorted(entries, key=lambda entry: float(entry['speed_mps']))

    def unknowns(self) -> list[Unknown]:
        """Return every null of the document with its reason, in the order of the document."""
        return [Unknown(path, self.reason(path)) for path in _nulls(self.document)]

    def reason(self, path: str) -> str:
        """
        Say why the entry at a path is null.

        The warnings that speak of it; for a branch, on which side of the model's
        critical speeds its speed lies; and if nothing gives a reason, that.
        """
        known = (
            self._branch_reason(path)
            or self._segment_reason(path)
            or reason_in(self.warnings, path)
        )
        if known:
            return known
        for key, subject in _SUBJECTS:
            found = re.match(key, path)
            if not found:
                continue
            words = subject.format(**found.groupdict()) if found.groupdict() else subject
            lines = [line for line in self.notices if re.search(words, line, re.IGNORECASE)]
            if lines:
                return lines[0].rstrip('.')
        if path.startswith('observed'):
            return 'no such jump of the amplitude is in the recordings'
        if path.startswith('disturbance_m'):
            return self._disturbance_reason()
        if not self.get('criticality') and re.match(r'v_|hyst|four_point|branches|coeff', path):
            whole = self.reason('criticality')
            return whole if whole != _NO_REASON else 'no normal form was identified'
        if path.startswith('four_point'):
            return 'the recipe needs four hunting states, near eps = -0.2, -0.1, 0 and 0.1'
        if re.match(r'v_n|hysteresis_width', path) and self.get('criticality'):
            kind = str(self.get('criticality'))
            return f'no fold below v_c: the identified form is {kind} without one'
        return _NO_REASON

    def _segment_reason(self, path: str) -> str:
        """Reason of a null of a stretch: what the stretch is, or ''."""
        found = re.match(r'segments\.(\d+)\.growth_rate', path)
        if not found:
            return ''
        kind = self.get(f'segments.{found.group(1)}.kind')
        return f'no growth rate is read from a {kind}' if kind != 'transient' else ''

    def _disturbance_reason(self) -> str:
        """Reason why no disturbance follows from the width: it needs two widths, one narrower."""
        model, seen = self.value('hysteresis_width'), self.value('observed.hysteresis_width')
        if model is None or seen is None:
            which = 'of the model' if model is None else 'seen in the jumps'
            return f'the hysteresis width {which} is not known'
        if seen >= model:
            return 'the observed hysteresis is no narrower than the model has it'
        return _NO_REASON

    def _branch_reason(self, path: str) -> str:
        """Reason of a missing branch point from the model's own critical speeds, or ''."""
        found = re.fullmatch(r'branches\.(\d+)\.(un)?stable_(?:amplitude|std|ci95)_m', path)
        if not found:
            return ''
        speed = float(self.document['branches'][int(found.group(1))]['speed_mps'])
        v_c, v_n = self.value('v_c'), self.value('v_n')
        if v_n is not None and speed < v_n:
            return 'the model has none below v_n'
        if v_n is None and v_c is not None and speed < v_c and not found.group(2):
            return 'the model has none below v_c'
        if found.group(2) and v_c is not None and speed >= v_c:
            return 'the model has none at or above v_c'
        if found.group(2) and self.get('criticality') == 'supercritical':
            return 'a supercritical rig has none'
        return ''


def _nulls(entry: Any, path: str = '') -> Iterator[str]:
    """Paths of the nulls below an entry; elements of lists are counted from 0."""
    if entry is None:
        yield path
    elif isinstance(entry, Mapping):
        for key, below in entry.items():
            yield from _nulls(below, f'{path}.{key}' if path else str(key))
    elif isinstance(entry, Sequence) and not isinstance(entry, str):
        for index, below in enumerate(entry):
            yield from _nulls(below, f'{path}.{index}')
