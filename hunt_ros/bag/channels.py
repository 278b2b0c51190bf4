"""
Where a channel comes from: a topic and a field, a column of a file, or a constant.

`lateral=/daq/ch0.data[3]*0.001` reads: the channel `lateral` is field `data[3]`
of topic `/daq/ch0`, times 0.001. The same notation names a column of a CSV file
(`lateral=y_mm*0.001`), a row of a MATLAB matrix (`yaw=data[0]`) and a constant
(`speed=16.3`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from hunt_ros.errors import BagError
from hunt_ros.samples import CHANNELS

#: What is taken for channels: name -> source, a list of `NAME=SOURCE`, or one of these.
Channels: TypeAlias = (
    'Mapping[str, ChannelSource | str | float] | Iterable[ChannelSource | str]'
    ' | ChannelSource | str'
)

EXAMPLE = 'lateral=/daq/ch0.data[3]*0.001'

_NUMBER = r'[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?'
# Not the sign of an exponent (4.7e-1), and not that of a factor (*-0.5).
_OFFSET = re.compile(
    rf'^(?P<rest>.*?[^\s*/+-])(?<![\d.][eE])\s*(?P<sign>[+-])\s*(?P<number>{_NUMBER})$', re.S
)
_SCALE = re.compile(rf'^(?P<rest>.*\S)\s*(?P<sign>[*/])\s*(?P<number>{_NUMBER})$', re.S)


@dataclass(frozen=True)
class ChannelSource:
    """
    One channel of a foreign recording: value = raw * scale + offset, or a constant.

    Parameters
    ----------
    channel : str
        Name it gets: one of `hunt_ros.samples.CHANNELS` where a record is made of
        it, any name where it is only exported.
    source : str
        `/topic.field.path[i]`, the last name of a topic, a column or a variable; '' for
        a constant.
    scale : float
        From the recorded unit to SI (0.001 for millimetres).
    offset : float
        In SI, added after scaling.
    constant : float or None
        Value at all times, in SI, in place of a source.
    """

    channel: str
    source: str
    scale: float = 1.0
    offset: float = 0.0
    constant: float | None = None

    @classmethod
    def parse(cls, text: str) -> ChannelSource:
        """
        Read `CHANNEL=SOURCE[*SCALE][+OFFSET]` or `CHANNEL=NUMBER`.

        A column whose name holds an operator is put in double quotes:
        `lateral="y-left"*0.001`.

        Raises
        ------
        BagError
            If the text has another form, or a number in it is not finite.
        """
        channel, equals, rest = text.partition('=')
        channel, rest = channel.strip(), rest.strip()
        if not equals or not channel or not rest:
            raise BagError(f'channel {text!r}: expected NAME=SOURCE, for example {EXAMPLE}')
        return cls.of(channel, rest)

    @classmethod
    def of(cls, channel: str, text: str) -> ChannelSource:
        """
        Read the part behind the equals sign.

        Raises
        ------
        BagError
            As `parse`.
        """
        text = text.strip()
        if re.fullmatch(_NUMBER, text):
            return cls(channel, '', constant=_finite(text, channel))
        offset, scale = 0.0, 1.0
        if match := _OFFSET.match(text):
            text = match['rest']
            offset = _finite(match['number'], channel) * (-1.0 if match['sign'] == '-' else 1.0)
        if match := _SCALE.match(text):
            text = match['rest']
            number = _finite(match['number'], channel)
            if match['sign'] == '/' and number == 0.0:
                raise BagError(f'channel {channel}: division by zero in {match[0]!r}')
            scale = number if match['sign'] == '*' else 1.0 / number
        if len(text) > 2 and text[0] == text[-1] == '"':
            text = text[1:-1]
        if not text or text.lower() in ('nan', 'inf', '+inf', '-inf'):
            raise BagError(f'channel {channel}: expected a source or a number, got {text!r}')
        return cls(channel, text, scale, offset)

    @property
    def topic(self) -> str:
        """Topic the source names; without a leading slash it is matched by its last name."""
        return self.source.partition('.')[0]

    @property
    def field(self) -> str:
        """Path of the field within the message; '' for the usual field of the type."""
        return self.source.partition('.')[2]

    def __str__(self) -> str:
        if self.constant is not None:
            return f'{self.channel}={self.constant!r}'
        source = self.source
        if _OFFSET.match(source) or _SCALE.match(source) or re.fullmatch(_NUMBER, source):
            source = f'"{source}"'
        scale = f'*{self.scale!r}' if self.scale != 1.0 else ''
        offset = f'{self.offset:+}' if self.offset else ''
        return f'{self.channel}={source}{scale}{offset}'


def channel_map(
    channels: Channels, allowed: Iterable[str] | None = CHANNELS
) -> dict[str, ChannelSource]:
    """
    Collect channels, however they are given, into a mapping.

    Parameters
    ----------
    channels : mapping, iterable, ChannelSource or str
        `{'lateral': '/daq/ch0.data[3]*0.001', 'speed': 16.3}`, or as on the command line:
        `['lateral=/daq/ch0.data[3]*0.001', 'speed=16.3']`.
    allowed : iterable of str or None
        Channel names that may occur; None for any.

    Raises
    ------
    BagError
        If a channel is named twice, is none of `allowed`, or has no source.
    """
    names = None if allowed is None else tuple(allowed)
    if isinstance(channels, Mapping):
        sources = [_named(str(name), value) for name, value in channels.items()]
    else:
        items = [channels] if isinstance(channels, str | ChannelSource) else channels
        sources = [
            item if isinstance(item, ChannelSource) else ChannelSource.parse(str(item))
            for item in items
        ]
    mapping: dict[str, ChannelSource] = {}
    for source in sources:
        if names is not None and source.channel not in names:
            raise BagError(f'channel {source.channel!r}: expected one of {", ".join(names)}')
        if source.channel in mapping:
            raise BagError(f'channel {source.channel!r} is given twice: expected one source')
        mapping[source.channel] = source
    return mapping


def _named(name: str, value: ChannelSource | str | float) -> ChannelSource:
    """Return the source of a channel that a mapping names."""
    if isinstance(value, ChannelSource):
        return replace(value, channel=name)
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise BagError(f'channel {name}: expected a source or a number, got {value!r}')
    return ChannelSource.of(name, str(value))


def _finite(text: str, channel: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise BagError(f'channel {channel}: {text} is not a finite number')
    return number
