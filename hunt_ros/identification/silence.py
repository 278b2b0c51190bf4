"""
Every null of a result has its reason, made once: a mapping of keys to reasons.

A key is the path in the JSON without the places in lists: 'v_n', 'coefficients.D4',
'branches.stable_amplitude_m'. The warnings say the same in lines, 'KEY, KEY not known: reason'.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

#: Lists that say something by being empty.
_LISTS = ('branches', 'steady_states')

#: Reasons that lie in what a quantity is, not in the data.
_ALWAYS: Mapping[str, str] = {
    'branches': 'at some speeds the law has no such limit cycle',
    'steady_states.amplitude_std_m': 'some steady states are too short for a deviation',
    'steady_states': 'the mean of the maxima is taken on plateaus only, over two cycles or more',
    'segments': 'a growth rate is read where a free transient is small for long enough',
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
    """Iterate over the paths of all entries that are None."""
    if entry is None:
        yield path
    elif isinstance(entry, Mapping):
        for key, below in entry.items():
            yield from _walk(below, f'{path}.{key}' if path else str(key))
    elif isinstance(entry, Sequence) and not isinstance(entry, str):
        for below in entry:
            yield from _walk(below, path)


def unknown_of(document: Mapping[str, Any], why: Mapping[str, str]) -> dict[str, str]:
    """
    Say of every null why it is not known.

    Parameters
    ----------
    document : mapping
        As `Identification.to_json` gives it.
    why : mapping of str to str
        Key, or the part of it before a dot -> reason; the longest that fits counts.

    Returns
    -------
    dict of str to str
        Key -> reason.
    """
    return {key: _reason(key, why) for key in nulls_of(document)}


def lines_of(unknown: Mapping[str, str]) -> list[str]:
    """Return a line for each reason, with the keys it stands for: 'KEY, KEY not known: reason'."""
    by_reason: dict[str, list[str]] = {}
    for key, reason in unknown.items():
        by_reason.setdefault(reason, []).append(key)
    return [f'{", ".join(keys)} not known: {reason}' for reason, keys in by_reason.items()]


def _reason(key: str, why: Mapping[str, str]) -> str:
    parts = key.split('.')
    starts = ['.'.join(parts[:count]) for count in range(len(parts), 0, -1)]
    for reasons in (why, _ALWAYS):
        for start in starts:
            if reasons.get(start):
                return reasons[start]
    return _UNEXPLAINED


def reason_in(unknown: Mapping[str, str], path: str) -> str:
    """
    Return the reason for a null; '' where there is none.

    Parameters
    ----------
    unknown : mapping of str to str
        As `unknown_of` gives it.
    path : str
        Path in the document; places in lists are left out of account, and what stands below
        a null has its reason.
    """
    parts = [part for part in path.split('.') if not part.isdecimal()]
    starts = ('.'.join(parts[:count]) for count in range(len(parts), 0, -1))
    return next((unknown[start] for start in starts if start in unknown), '')
