"""
A speed profile as an experimenter writes it: steps in YAML, shared by drive, demo and simulation.

docs/profiles.md is the description of the format for people.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import yaml

from hunt_ros.dynamics.profile.step import Motion, Step
from hunt_ros.dynamics.profile.steps import STEPS
from hunt_ros.errors import ConfigError
from hunt_ros.files import read_text
from hunt_ros.settings import yaml_document, yaml_value

_WORDS = {kind: word for word, kind in STEPS.items()}


@dataclass(frozen=True)
class Profile:
    """
    A sequence of steps.

    Parameters
    ----------
    steps : tuple of Step
        At least one.
    name : str
        For people.

    Raises
    ------
    ConfigError
        Without a step.
    """

    steps: tuple[Step, ...]
    name: str = ''
    source: str = field(default='profile', compare=False)

    def __post_init__(self) -> None:
        if not self.steps:
            raise ConfigError(f'{self.source}: no step in it')

    @property
    def reacts(self) -> bool:
        """True where the detector decides how it goes."""
        return any(step.reacts for step in self.steps)

    def durations_s(self, begin_mps: float = math.nan) -> list[float]:
        """
        Return how long each step lasts, s, at most where it reacts to the detector.

        Parameters
        ----------
        begin_mps : float
            Where the roller runs before; NaN: at the first speed of the profile.
        """
        before = begin_mps
        found = []
        for step in self.steps:
            total = 0.0
            for leg in step.plan():
                if math.isfinite(leg.speed_mps):
                    way = 0.0 if math.isnan(before) else abs(leg.speed_mps - before)
                    total += way / leg.rate_mps2
                    before = leg.speed_mps
                total += leg.hold_s
            found.append(total)
        return found

    @property
    def duration_s(self) -> float:
        """How long it lasts from its first speed on, s; at most where it reacts."""
        return sum(self.durations_s())

    def missing(self, motion: Motion) -> str:
        """Return '' or what a step has to know of the detector, and does not."""
        for number, step in enumerate(self.steps, 1):
            if problem := step.missing(motion):
                return f'{self._where(number, step)}: {problem}'
        return ''

    def check(self, ceiling_mps: float) -> None:
        """
        Refuse a profile that would be faster than the roller may turn.

        Raises
        ------
        ConfigError
            Naming the step and the speed.
        """
        for number, step in enumerate(self.steps, 1):
            for leg in step.plan():
                if leg.speed_mps > ceiling_mps:
                    raise ConfigError(
                        f'{self._where(number, step)}: {leg.speed_mps:g} m/s is above the'
                        f' ceiling, {ceiling_mps:g} m/s'
                    )

    def corners(self) -> tuple[list[float], list[float]]:
        """
        Return the set point against time, for a simulation without a detector.

        Returns
        -------
        times_s, speeds_mps : list of float
            Ends of the straight lines; the last speed is held.

        Raises
        ------
        ConfigError
            Where the detector decides how it goes.
        """
        if self.reacts:
            raise ConfigError(f'{self.source}: it reacts to the detector, and none is there')
        times, speeds = [0.0], [self.steps[0].begin_mps(Motion())]
        for leg in (leg for step in self.steps for leg in step.plan()):
            for way_s in (abs(leg.speed_mps - speeds[-1]) / leg.rate_mps2, leg.hold_s):
                if way_s > 0.0:
                    times.append(times[-1] + way_s)
                    speeds.append(leg.speed_mps)
            if leg.speed_mps != speeds[-1]:  # a jump
                times.append(math.nextafter(times[-1], math.inf))
                speeds.append(leg.speed_mps)
        return times, speeds

    def _where(self, number: int, step: Step) -> str:
        return f'{self.source}, step {number} ({_WORDS[type(step)]})'

    def to_yaml(self) -> str:
        """Return the text that `from_yaml` reads; what has its default is left out."""
        steps = []
        for step in self.steps:
            default = {item.name: item.default for item in fields(step)}
            values = {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in asdict(step).items()
                if value != default[name]
            }
            steps.append({_WORDS[type(step)]: values})
        document: dict[str, Any] = {'name': self.name} if self.name else {}
        document['profile'] = steps
        text: str = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=99)
        return text

    @classmethod
    def from_yaml(cls, text: str, source: str = 'profile') -> Profile:
        """
        Read a profile.

        Parameters
        ----------
        text : str
            YAML: a mapping with the key `profile`, a list of steps, and perhaps `name`.
        source : str
            Named in messages.

        Raises
        ------
        ConfigError
            One line: what, in which step, and what was expected.
        """
        document = yaml_document(text, source)
        if not isinstance(document, Mapping) or 'profile' not in document:
            raise ConfigError(f'{source}: no profile, expected "profile:" and a list of steps')
        for key in document:
            if key not in ('profile', 'name'):
                raise ConfigError(f'{source}: unknown key {key!r}, expected profile, name')
        items = document['profile']
        if not isinstance(items, Sequence) or isinstance(items, str) or not items:
            raise ConfigError(f'{source}: profile: expected a list of steps, got {items!r}')
        steps = tuple(_step(item, f'{source}, step {k}') for k, item in enumerate(items, 1))
        return cls(steps, str(document.get('name', '')), source)

    @classmethod
    def read(cls, words: str) -> Profile:
        """
        Read the text of a profile, or the file that the words name.

        Raises
        ------
        ConfigError
            If there is no such file, or it is no profile.
        """
        if 'profile:' in words:
            return cls.from_yaml(words)
        found = cls.from_yaml(read_text(words, 'profile'), words)
        return found if found.name else replace(found, name=Path(words).stem)


def _step(item: object, where: str) -> Step:
    """Read one step."""
    if not isinstance(item, Mapping) or len(item) != 1:
        raise ConfigError(f'{where}: {item!r} is no step, expected one of {", ".join(STEPS)}')
    ((word, values),) = item.items()
    if word not in STEPS:
        raise ConfigError(f'{where}: unknown step {word!r}, expected one of {", ".join(STEPS)}')
    kind, where = STEPS[word], f'{where} ({word})'
    if not isinstance(values, Mapping):
        raise ConfigError(f'{where}: {values!r} is no mapping of {_keys(kind)}')
    defaults = {item.name: item.default for item in fields(kind)}
    for key in values:
        if key not in defaults:
            raise ConfigError(f'{where}: unknown key {key!r}, expected {_keys(kind)}')
    try:
        step = kind(**{key: yaml_value(defaults[key], value) for key, value in values.items()})
    except (ConfigError, TypeError, ValueError) as error:
        raise ConfigError(f'{where}: {" ".join(str(error).split())}') from error
    for each in fields(kind):
        value = getattr(step, each.name)
        if isinstance(value, float) and math.isnan(value):
            raise ConfigError(f'{where}: {each.name} is missing, expected {_keys(kind)}')
    return step


def _keys(kind: type[Step]) -> str:
    return ', '.join(each.name for each in fields(kind))
