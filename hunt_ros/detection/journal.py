"""
What happened to a live detector beside its samples, so that a replay can repeat it.

The samples and their stamps are in the recording. What is not: the settings, with which
sample the detector began, when a silent channel was let go and came back, when the operator
acknowledged or a new normal form arrived. Each is an
entry with the *position* at which it acted, that is the last row made before it.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace

from hunt_ros.errors import HuntError
from hunt_ros.settings import Settings

KINDS = (
    'start',  # of the detector: with `config`
    'heard',  # the first samples of `channels` since the start
    'back',  # twice, before and behind the samples with which a clock that had leapt is back
    'released',  # tick: `channels` were silent and are not waited for any more
    'offset',  # tick: `offsets` are added to the stamps of `channels` that come after it
    'resumed',  # tick: `channels` speak again and are waited for
    'late_from',  # of 0.2.0
    'late_to',
    'clock',  # tick: the epoch was left because the clocks were set back
    'settings',  # reconfigure: from here on with `config`
    'normal_form',  # set_normal_form: `text` is its parameter file, empty for none
    'acknowledged',  # acknowledge
    'finished',  # finish
)


@dataclass(frozen=True)
class JournalEntry:
    """
    One entry.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    position_ns : int or None
        Last row before it acted; None before the first row of an epoch.
    epoch : int
        Number of clock resets before it.
    now_ns : int
        The time given with the call; 0 where none is.
    channels : mapping of str to int or None
        Channel and the stamp of a sample: for 'heard' the first, for others the last one received
        before, as it came. None: no sample yet.
    received : mapping of str to int
        Channel and how many samples of it had been received since the start.
    offsets : mapping of str to int
        For 'offset': channel and ns.
    text : str
        For 'start' and 'normal_form' a parameter file; for 'acknowledged' who did, where that
        is known.
    config : mapping of str to object
        For 'start' and 'settings': every setting of the detector by name.
    companions : mapping of str to object
        For 'start' of a node: every setting of what runs beside the detector, see
        `CompanionConfig`; empty in earlier recordings.
    """

    kind: str
    position_ns: int | None
    epoch: int = 0
    now_ns: int = 0
    channels: dict[str, int | None] = field(default_factory=dict)
    received: dict[str, int] = field(default_factory=dict)
    offsets: dict[str, int] = field(default_factory=dict)
    text: str = ''
    config: dict[str, object] = field(default_factory=dict)
    companions: dict[str, object] = field(default_factory=dict)

    def beside(self, companions: Settings) -> JournalEntry:
        """Return the entry with the settings of what runs beside the detector, if it starts it."""
        if self.kind != 'start':
            return self
        return replace(self, companions=asdict(companions))

    def to_text(self) -> str:
        """Return the entry as one line of JSON; what is empty is left out."""
        told = {k: v for k, v in self.__dict__.items() if v or k in ('kind', 'position_ns')}
        return json.dumps(told, separators=(',', ':'))

    @classmethod
    def from_text(cls, text: str) -> JournalEntry:
        """
        Read what `to_text` wrote.

        Raises
        ------
        HuntError
            If it is something else.
        """
        try:
            told = json.loads(text)
            for pause in ('memory', 'kept'):  # of 0.2.0, which went on after one
                told.pop(pause, None)
            entry = cls(**told)
        except (ValueError, TypeError, AttributeError) as error:
            raise HuntError(f'journal entry {text[:60]!r} cannot be read: {error}') from error
        if entry.kind not in KINDS:
            raise HuntError(f'journal entry of kind {entry.kind!r}, expected one of {KINDS}')
        return entry
