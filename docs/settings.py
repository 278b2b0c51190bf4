"""
Write docs/settings.md from the settings: `make settings`.

What a node declares is read off its source (`declare(self, CLASS, ...)`), so that no list of nodes
and classes has to be kept here.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import Field, fields
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from math import inf
from pathlib import Path

from hunt_ros.rig import PARAMETERS, Rig
from hunt_ros.settings import Settings
from hunt_ros.suite import NODES, SENSORS

PAGE = Path(__file__).with_name('settings.md')

HEAD = """# Settings

This page is made from the settings in the code (`make settings`); `ros2 param describe` says the
same of a node that runs. A parameter that is set *at the start* is read-only while the node runs.
0 or .inf means "not given" or "off" where the meaning says so.

## The rig
What describes the rig stands once, in the section `/**` of a ROS parameter file such as
`config/rig.yaml`: each node takes what it needs, every verb reads it by `--rig FILE`, and an
option of a verb wins over the file. A key that is none of these, or in another unit, is refused
with one line.
"""
#: Behind the name of a node, what to know of its settings.
WORDS = {
    'hunting_detector': """\
Each is an option `--set NAME=VALUE` of `hunt replay` too, as are those of the rig that it needs. A
change while the rig runs takes effect with the next row and stands in the journal.""",
    'alarm_outputs': 'What they do: [sound, command, relay](alarm.md#sound-command-relay).',
    'roller_speed': """\
What the interlock does: [the interlock](interlock.md); steps of a profile:
[profiles](profiles.md).""",
    'bag_recorder': 'What a recording holds: [recordings](recordings.md).',
    'dashboard': 'Who may see it: [the page](page.md).',
}
#: What a lab sets first; then the other nodes, as the suite has them.
FIRST = ('hunting_detector', 'roller_speed', 'alarm_outputs')
TABLE = """| parameter | default | unit | range | set | meaning |
|---|---|---|---|---|---|
"""


def page() -> str:
    """Return the text of the page."""
    parts = [HEAD + '\n' + table((item, True) for item in fields(Rig))]
    done = set()
    for node in dict.fromkeys((*FIRST, *NODES)):
        name = 'the sensor nodes' if node in SENSORS.values() else f'`{node}`'
        if name not in done:
            done.add(name)
            words = f'{WORDS[node]}\n\n' if node in WORDS else ''
            parts.append(f'## {name[0].upper()}{name[1:]}\n{words}{table(own(node))}')
    parts.append('## Drivers\nParameters of the node that has it: [drivers](drivers.md).\n')
    for name, classes in drivers():
        items = {item.name: item for kind in classes for item in fields(kind)}
        if items:
            parts.append(f'### `{name}`\n' + table((item, False) for item in items.values()))
    return '\n'.join(parts)


def own(node: str) -> list[tuple[Field, bool]]:
    """Return the settings that a node declares, those of the rig left out, and which follow."""
    module = 'support.sensor' if node in SENSORS.values() else node
    return [
        (item, live)
        for kind, live in declared(f'hunt_ros.nodes.{module}')
        for item in fields(kind)
        if item.name not in PARAMETERS
    ]


def declared(module: str) -> Iterator[tuple[type[Settings], bool]]:
    """Yield what a module declares parameters of, and whether a running node follows them."""
    loaded = import_module(module)
    for call in ast.walk(ast.parse(Path(loaded.__file__).read_text(encoding='utf-8'))):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and len(call.args) > 1:
            kind = call.args[1]
            if call.func.id == 'declare' and isinstance(kind, ast.Name):
                yield getattr(loaded, kind.id), len(call.args) + len(call.keywords) > 2


def drivers() -> list[tuple[str, list[type[Settings]]]]:
    """Return the settings of each driver of this package, of its sensor and of its drive."""
    found = []
    for point in sorted(entry_points(group='hunt_ros.drivers'), key=lambda point: point.name):
        if point.value.startswith('hunt_ros.') and find_spec(point.value):
            module = point.load()
            kinds = [getattr(module, name, None) for name in ('Sensor', 'Drive')]
            found.append((point.name, [kind.Settings for kind in kinds if kind is not None]))
    return found


def table(items) -> str:
    """Return one row for each setting: its field, and whether a running node follows it."""
    return TABLE + ''.join(row(item, live) for item, live in items)


def row(item: Field, live: bool) -> str:
    """Return the row of a setting."""
    told, default = item.metadata, item.default
    low, high = told['low'], told['high']
    bounds = ', '.join(told['choices'])
    if low is not None:
        bounds = f'at least {low:g}' if high in (None, inf) else f'{low:g} to {high:g}'
    if isinstance(default, tuple):
        shown = ', '.join(map(str, default))
    elif isinstance(default, (bool, str)):
        shown = str(default).lower() if isinstance(default, bool) else default
    else:
        shown = '.inf' if default == inf else f'{default:g}'
    when = 'at any time' if live and not told['fixed'] else 'at the start'
    meaning = told['description'].rstrip('.').replace('|', '\\|')
    cells = (f'`{item.name}`', shown, told['unit'], bounds, when, meaning)
    return f'| {" | ".join(cells)} |\n'


if __name__ == '__main__':
    PAGE.write_text(page(), encoding='utf-8')
