"""
How the report reads an identification: by the public JSON keys, and never past a null.

Everything shown comes from the document that `hunt identify --json` writes, so the
page and the JSON cannot disagree. What is null there is 'not known', and is shown with
the reason that its entry `unknown` gives for it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hunt_ros.identification.silence import lines_of, reason_in

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
        reasons = lines_of(self._unknown)
        return tuple(line for line in self.warnings if line not in reasons)

    @property
    def _unknown(self) -> Mapping[str, str]:
        """Key -> why it is not known."""
        return self.document.get('unknown') or {}

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

        For a branch, on which side of the model's critical speeds its speed lies; for a
        stretch, what it is; else what the identification says of it.
        """
        return (
            self._branch_reason(path)
            or self._segment_reason(path)
            or reason_in(self._unknown, path)
            or _NO_REASON
        )

    def _segment_reason(self, path: str) -> str:
        """Reason of a null of a stretch: what the stretch is, or ''."""
        found = re.match(r'segments\.(\d+)\.growth_rate', path)
        if not found:
            return ''
        kind = self.get(f'segments.{found.group(1)}.kind')
        return f'no growth rate is read from a {kind}' if kind != 'transient' else ''

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
