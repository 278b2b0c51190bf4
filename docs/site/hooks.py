"""What the site has beyond the files of docs/: README.md and the notebook, as pages."""

from __future__ import annotations

import json
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages `index.md` and `tutorial.md`."""
    files.append(File.generated(config, 'index.md', content=overview()))
    files.append(File.generated(config, 'tutorial.md', content=tutorial()))
    return files


def overview() -> str:
    """Return README.md: its links into docs/ stay inside the site."""
    text = (ROOT / 'README.md').read_text(encoding='utf-8').replace('](docs/', '](')
    # What is no part of the site is named, not linked.
    outside = (
        r'(?<!!)\[([^\]]+)\]\((?:CONTRIBUTING\.md|LICENSE|(?:bags|config|launch|test)/[^)]*)\)'
    )
    return re.sub(outside, r'`\1`', text)


def tutorial() -> str:
    """Return the cells of the notebook, without results."""
    notebook = json.loads((ROOT / 'docs/tutorial.ipynb').read_text(encoding='utf-8'))
    texts = []
    for cell in notebook['cells']:
        text = ''.join(cell['source'])
        texts.append(text if cell['cell_type'] == 'markdown' else f'```python\n{text}\n```')
    return '\n\n'.join(texts)
