"""Every command that the README and the help texts show is run, word for word."""

from __future__ import annotations

import math
import re
import shlex
from pathlib import Path

import pytest

from hunt_ros.cli.main import VERBS, main, module_of

HERE = Path(__file__).parents[2]
#: These start nodes: `test/nodes` runs them.
WITH_ROS = ('hunt demo', 'hunt run', 'hunt call')


def in_readme() -> list[str]:
    """Commands of the code blocks, in their order, as one line each."""
    text = (HERE / 'README.md').read_text(encoding='utf-8')
    blocks = re.findall(r'```sh\n(.*?)```', text, re.DOTALL)
    lines = '\n'.join(blocks).replace('\\\n', ' ').splitlines()
    return [line for line in lines if line.startswith('hunt ') and needs_no_ros(line)]


def in_help() -> list[str]:
    examples = [module_of(verb).EXAMPLE for verb in VERBS]
    return [example for example in examples if needs_no_ros(example)]


def needs_no_ros(command: str) -> bool:
    return not command.startswith(WITH_ROS) and '--live' not in command


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder in which the files of the repository are found, and results may be written."""
    for name in ('bags', 'config'):
        (tmp_path / name).symlink_to(HERE / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_commands_of_the_readme_run_one_after_the_other(place, capsys) -> None:
    commands = in_readme()
    assert len(commands) >= 2
    for command in commands:
        assert main(shlex.split(command, comments=True)[1:]) == 0, command
    assert 'LIMIT CYCLE' in capsys.readouterr().out


@pytest.mark.parametrize(
    'command',
    [
        pytest.param(one, marks=pytest.mark.slow if one.startswith('hunt report') else ())
        for one in in_help()
    ],
)
def test_the_example_of_a_verb_runs(place, command) -> None:
    assert main(shlex.split(command)[1:]) == 0


@pytest.mark.parametrize('verb', ['demo', 'run', 'call'])
def test_the_example_of_a_verb_with_ros_names_what_is_there(verb) -> None:
    """It is understood, and the files in it exist."""
    from hunt_ros.cli.main import parser_of

    words = shlex.split(module_of(verb).EXAMPLE)[1:]
    parsed = parser_of(verb).parse_args(words)
    named = [value for value in vars(parsed).values() if isinstance(value, Path)]
    assert all((HERE / path).exists() for path in named if path.suffix)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('page', 'said'), [('docs/library.md', 'limit_cycle'), ('README.md', '±')]
)
def test_the_examples_of_the_library_run_one_after_the_other(place, capsys, page, said) -> None:
    text = (HERE / page).read_text(encoding='utf-8')
    names: dict[str, object] = {}
    blocks = re.findall(r'```python\n(.*?)```', text, re.DOTALL)
    assert blocks
    for block in blocks:
        exec(compile(block, page, 'exec'), names)
    assert said in capsys.readouterr().out


NUMBER = r'\d+(?:\.\d+)?'


def begins(said: str, shown: str) -> bool:
    """Return True if a line begins as it is shown, its numbers but for what machines differ in."""
    shapes = [re.sub(NUMBER, '#', ' '.join(line.split())) for line in (said, shown)]
    numbers = [[float(x) for x in re.findall(NUMBER, line)] for line in (said, shown)]
    near = [
        math.isclose(*pair, rel_tol=0.05, abs_tol=0.05) for pair in zip(*numbers, strict=False)
    ]
    return shapes[0].startswith(shapes[1]) and all(near[: len(numbers[1])])


@pytest.mark.slow
@pytest.mark.parametrize('page', ['first-run', 'alarm', 'my-rig'])
def test_the_commands_of_a_page_print_what_it_shows(place, capsys, page) -> None:
    text = (HERE / 'docs' / f'{page}.md').read_text(encoding='utf-8')
    parts = re.findall(r'```sh\n(.*?)```\n(?:```text\n(.*?)```)?', text, re.DOTALL)
    shown = 0
    for commands, expected in parts:
        said = []
        for line in commands.splitlines():
            if line.startswith('hunt ') and needs_no_ros(line):
                assert main(shlex.split(line, comments=True)[1:]) == 0, line
                said += capsys.readouterr().out.splitlines()
        for line in expected.splitlines():
            assert any(begins(one, line) for one in said), line
            shown += 1
    assert page != 'first-run' or shown > 10
