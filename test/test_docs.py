"""The documentation: its links lead somewhere, its site has every page, and builds."""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from runpy import run_path
from typing import Any

import pytest
import yaml
from made import python

from hunt_ros.detection import HuntingDetector
from hunt_ros.detection.output import EVENT_NUMBERS, PUBLIC

ROOT = Path(__file__).parents[1]
SITE = ROOT / 'docs' / 'site'
PAGES = [
    *(ROOT / name for name in ('README.md', 'CONTRIBUTING.md', 'QUALITY_DECLARATION.md')),
    ROOT / 'bags' / 'README.md',
    *sorted((ROOT / 'docs').rglob('*.md')),
]
#: Pages that the site makes itself (docs/site/hooks.py).
MADE = {'index.md', 'tutorial.md'}


def prose(page: Path) -> str:
    """Return the text of a page without its blocks of code."""
    return re.sub(r'```.*?```', '', page.read_text(encoding='utf-8'), flags=re.DOTALL)


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page, by its headings."""
    headings = re.findall(r'^#+ (.+)$', prose(page), re.MULTILINE)
    plain = (re.sub(r'[^\w\- ]', '', heading.lower()).strip() for heading in headings)
    return {re.sub(r' +', '-', heading) for heading in plain}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_to_a_file_leads_to_one(page: Path) -> None:
    for target in re.findall(r'\]\(([^)\s]+)\)', prose(page)):
        if re.match(r'[a-z]+:', target):
            continue
        name, _, anchor = target.partition('#')
        file = page.parent / name if name else page
        assert file.exists(), f'{page.name}: {target}'
        if anchor:
            assert anchor in anchors(file), f'{page.name}: {target}'


def test_the_readme_fits_a_screen_and_its_commands_are_there() -> None:
    """What `hunt` and Python do in it is run by test/cli/test_examples.py."""
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    assert len(text.split()) <= 900
    targets = set(re.findall(r'^([a-z-]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE))
    blocks = re.findall(r'```(\w*)\n(.*?)```', text, re.DOTALL)
    assert {kind for kind, _ in blocks} == {'sh', 'python'}
    for _, block in (block for block in blocks if block[0] == 'sh'):
        for line in block.replace('\\\n', ' ').splitlines():
            program, word, *_ = line.split()
            assert program in ('hunt', '.') or (program == 'make' and word in targets), line


def test_the_page_of_the_topics_has_every_value_of_the_status_and_the_events() -> None:
    page = (ROOT / 'docs/topics.md').read_text(encoding='utf-8')
    derived = re.compile(r'_(std|low|high)(?=_|$)')  # told with the number that they belong to
    for key in {*HuntingDetector().status.values} - {*PUBLIC.values()} | {*EVENT_NUMBERS}:
        assert f'`{derived.sub("", key)}`' in page, key


def nav() -> list[str]:
    def leaves(node: Any) -> list[str]:
        if isinstance(node, str):
            return [node]
        children = node.values() if isinstance(node, dict) else node
        return [leaf for child in children for leaf in leaves(child)]

    return leaves(yaml.safe_load((SITE / 'mkdocs.yml').read_text(encoding='utf-8'))['nav'])


def test_the_site_has_every_page_once() -> None:
    """A new page of docs/ gets a line in `nav` of docs/site/mkdocs.yml."""
    pages = {str(page.relative_to(ROOT / 'docs')) for page in (ROOT / 'docs').rglob('*.md')}
    assert sorted(nav()) == sorted(pages | MADE)


def test_what_the_reference_names_is_there_and_has_a_docstring() -> None:
    names = re.findall(r'^::: (\S+)$', (SITE / 'reference.md').read_text(), re.MULTILINE)
    assert len(names) > 15
    for name in names:
        module, _, member = name.rpartition('.')
        found = resolve_name(name if member == 'errors' else f'{module}:{member}')
        assert found.__doc__, name


@pytest.mark.slow
@pytest.mark.skipif(find_spec('mkdocs') is None, reason='needs the extra docs: make docs')
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    words = ['-m', 'mkdocs', 'build', '--strict', '--config-file', str(SITE / 'mkdocs.yml')]
    python(*words, '--site-dir', tmp_path / 'site')
    assert (tmp_path / 'site' / 'index.html').is_file()


def test_the_page_of_the_settings_is_what_the_code_says() -> None:
    """`make settings` writes it."""
    pytest.importorskip('rclpy', reason='the nodes declare them')
    written = run_path(str(ROOT / 'docs/settings.py'))['page']()
    assert (ROOT / 'docs/settings.md').read_text(encoding='utf-8') == written


@pytest.mark.slow
def test_the_animation_shows_a_trip_that_keeps_the_rig_out_of_the_limit_cycle() -> None:
    """What docs/animation.py draws still happens."""
    guarded, alone = run_path(str(ROOT / 'docs/animation.py'))['run']()
    assert 'ERROR' in guarded.level
    assert guarded.level[-1] in ('OK', 'WARN')
    assert max(guarded.amplitude) < 0.8 * max(alone.amplitude)
    assert alone.state[-1] == 'limit cycle'
    assert min(guarded.speed) < min(alone.speed) - 0.5


def test_what_it_can_says_the_numbers_that_were_measured() -> None:
    """Each number of the column `measured` stands in the section that the command prints."""
    page = (ROOT / 'docs/what-it-can.md').read_text(encoding='utf-8')
    measured = (ROOT / 'docs/benchmarks.md').read_text(encoding='utf-8')
    rows = re.findall(r'^\| .+\? \| (.+?) \| .+? \| `make ([a-z-]+)` \|$', page, re.MULTILINE)
    assert len(rows) == 10
    for said, command in rows:
        begin, end = f'<!-- {command} -->', f'<!-- /{command} -->'
        section = measured.partition(begin)[2].partition(end)[0]
        for number in re.findall(r'\b\d+(?:\.\d+)?\b(?! %\))', said):
            alone = rf'(?<![\d.]){re.escape(number)}(?![\d.]*\d)'
            assert re.search(alone, section), (command, number)


def test_the_map_names_files_that_are_there() -> None:
    """Of CONTRIBUTING.md: files of the package, or of the repository."""
    text = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    table = text.partition('## To change X')[2].partition('\n## ')[0]
    names = re.findall(r'`([a-z_]+(?:/[a-z_]+)*(?:\.\w+)?)`', table)
    files = [name for name in names if '/' in name or '.' in name]
    assert len(files) > 20
    for name in files:
        assert (ROOT / name).exists() or (ROOT / 'hunt_ros' / name).exists(), name


def test_each_defect_of_before_names_a_test_that_is_there() -> None:
    text = (ROOT / 'docs' / 'faults.md').read_text()
    rows = re.findall(r'^\| D(\d+) \| .* \| `(.*)`: `(.*)` \|$', text, re.M)
    assert [int(number) for number, _, _ in rows] == list(range(1, 1 + len(rows)))
    assert len(rows) > 33
    for _, file, name in rows:
        assert f'def {name}(' in (ROOT / 'test' / file).read_text(), name
