"""There are few settings, and the documentation names each with unit, range and meaning."""

from __future__ import annotations

from dataclasses import Field, fields
from pathlib import Path

from hunt_ros.detection import DetectorConfig
from hunt_ros.rig import PARAMETERS, Rig

DOCUMENT = Path(__file__).parents[2] / 'docs' / 'settings.md'
#: More than a person who sets up a rig reads.
MOST = 25


def _row(item: Field) -> str:
    told = item.metadata
    low, high = told['low'], told['high']
    if low is None and high is None:
        bounds = ''
    elif high is None:
        bounds = f'at least {low:g}'
    else:
        bounds = f'{low:g} to {high:g}'
    default = item.default
    if isinstance(default, tuple):
        shown = ', '.join(map(str, default))
    else:
        shown = default if isinstance(default, str) else f'{default:g}'
    when = 'at the start' if told['fixed'] else 'at any time'
    cells = (f'`{item.name}`', shown, told['unit'], bounds, when, told['description'])
    return f'| {" | ".join(cells)} |'


def test_there_are_few_settings() -> None:
    assert len(fields(DetectorConfig)) <= MOST


def test_each_setting_says_what_it_is() -> None:
    for item in fields(DetectorConfig):
        assert item.metadata['description'], item.name
        if isinstance(item.default, float):
            assert item.metadata['low'] is not None, item.name


def test_the_documentation_names_every_setting_as_it_is() -> None:
    own = [item for item in fields(DetectorConfig) if item.name not in PARAMETERS]
    rows = [_row(item) for item in (*fields(Rig), *own)]
    lines = DOCUMENT.read_text(encoding='utf-8').splitlines()
    assert [line for line in lines if line.startswith('| `')] == rows
