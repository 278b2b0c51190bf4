"""
Every null of a result has its reason: a warning that names the keys and says why.

A warning of this kind reads 'KEY, KEY not known: reason'. A key is the path in the JSON
without the places in lists: 'v_n', 'coefficients.D4', 'branches.stable_amplitude_m'.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

#: Between the keys and the reason.
NOT_KNOWN = ' not known: '

#: Lists that say something by being empty.
_LISTS = ('branches', 'steady_states')

#: Reasons that lie in what a quantity is, not in the data.
_ALWAYS: Mapping[str, str] = {
    'branches': 'at some speeds the law has no such limit cycle',
    'steady_states.amplitude_std_m': 'some steady states are too short for a deviation',
    'steady_states': 'the mean of the maxima is taken on plateaus only, over two cycles or more',
    'segments': 'a growth rate is read where a free transient is small for long enough',
    'days.hits': 'some of the free motion was small for too short a time',
    'fit.lack_of_fit_p': 'fewer than eight hunting states at several speeds: no test of the fit',
    'fit': 'the information of the fit is singular',
    'frequency_hz': 'no line stands out',
}
_UNEXPLAINED = 'the data do not show it'


def nulls_of(document: Mapping[str, Any]) -> list[str]:
    """
    Return the keys that are null, or empty where that says something, each once.

    Parameters
    ----------
    document : mapping
        As `Identification.to_json` gives it.
    """
    found = [key for key in _LISTS if not document.get(key, True)]
    return list(dict.fromkeys([*found, *_walk(document, '')]))


def _walk(entry: Any, path: str) -> Iterator[str]:
    if entry is None:
        yield path
    elif isinstance(entry, Mapping):
        for key, below in entry.items():
            yield from _walk(below, f'{path}.{key}' if path else str(key))
    elif isinstance(entry, Sequence) and not isinstance(entry, str):
        for below in entry:
            yield from _walk(below, path)


def silences(document: Mapping[str, Any], why: Mapping[str, str]) -> list[str]:
    """
    Say of every null why it is not known: one line for each reason.

    Parameters
    ----------
    document : mapping
        As `Identification.to_json` gives it.
    why : mapping of str to str
        Key, or the part of it before a dot -> reason; the longest that fits counts.

    Returns
    -------
    list of str
        'KEY, KEY not known: reason'.
    """
    by_reason: dict[str, list[str]] = {}
    for key in nulls_of(document):
        by_reason.setdefault(_reason(key, why), []).append(key)
    return [f'{", ".join(keys)}{NOT_KNOWN}{reason}' for reason, keys in by_reason.items()]


def _reason(key: str, why: Mapping[str, str]) -> str:
    parts = key.split('.')
    starts = ['.'.join(parts[:count]) for count in range(len(parts), 0, -1)]
    for reasons in (why, _ALWAYS):
        for start in starts:
            if reasons.get(start):
                return reasons[start]
    return _UNEXPLAINED


def reason_in(warnings: Sequence[str], key: str) -> str:
    """
    Return the reason that the warnings give for a null; '' where none names it.

    Parameters
    ----------
    warnings : sequence of str
        Of a result.
    key : str
        Path in the document; places in lists are left out of account.
    """
    plain = re.sub(r'\.\d+(?=\.|$)', '', key)
    for line in warnings:
        keys, mark, reason = line.partition(NOT_KNOWN)
        if mark and plain in keys.split(', '):
            return reason
    return ''


def is_silence(warning: str) -> bool:
    """Whether a warning is one that only says why keys are null."""
    keys, mark, _ = warning.partition(NOT_KNOWN)
    return bool(mark) and re.fullmatch(r'[\w.]+(, [\w.]+)*', keys) is not None


def worth_saying(warnings: Sequence[str]) -> list[str]:
    """
    Leave out the silences that concern only entries of tables, for a reader in a hurry.

    Parameters
    ----------
    warnings : sequence of str
        Of a result.
    """
    tables = ('branches.', 'steady_states.', 'segments.', 'days.')
    return [
        line
        for line in warnings
        if not is_silence(line) or not all(key.startswith(tables) for key in _keys(line))
    ]


def _keys(warning: str) -> list[str]:
    return warning.partition(NOT_KNOWN)[0].split(', ')
