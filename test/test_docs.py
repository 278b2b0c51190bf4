"""The documentation: its links lead somewhere, its site has every page, and builds."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
SITE = ROOT / 'docs' / 'site'
PAGES = [
    ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', ROOT / 'bags' / 'README.md',
    *sorted((ROOT / 'docs').rglob('*.md')),
]  # fmt: skip
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
    done = subprocess.run(
        [sys.executable, *words, '--site-dir', str(tmp_path / 'site')],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / 'site' / 'index.html').is_file()
