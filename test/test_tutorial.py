"""The notebook runs as it stands, from top to bottom, in its own folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib
import pytest

DOCS = Path(__file__).parents[1] / 'docs'
NOTEBOOK = DOCS / 'tutorial.ipynb'


def cells(kind: str) -> list[dict[str, Any]]:
    notebook = json.loads(NOTEBOOK.read_text(encoding='utf-8'))
    return [cell for cell in notebook['cells'] if cell['cell_type'] == kind]


def test_the_notebook_is_committed_without_outputs() -> None:
    notebook = json.loads(NOTEBOOK.read_text(encoding='utf-8'))
    assert (notebook['nbformat'], notebook['nbformat_minor']) == (4, 5)
    names = [cell['id'] for cell in notebook['cells']]
    assert len(set(names)) == len(names)
    for cell in cells('code'):
        assert cell['outputs'] == []
        assert cell['execution_count'] is None


def test_the_notebook_needs_no_ros() -> None:
    assert not [cell for cell in cells('code') if 'hunt_ros.nodes' in ''.join(cell['source'])]


@pytest.mark.slow
def test_the_cells_run_one_after_the_other(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt

    monkeypatch.chdir(DOCS)
    names: dict[str, Any] = {}
    try:
        for cell in cells('code'):
            exec(compile(''.join(cell['source']), f'{NOTEBOOK.name}: {cell["id"]}', 'exec'), names)
        assert len(plt.get_fignums()) >= 3
    finally:
        plt.close('all')
    # What the text says of the results.
    result = names['result']
    assert abs(result.v_n.value - 6.4) < 4.0 * result.v_n.std
    assert abs(result.v_c.value - 8.0) < 4.0 * result.v_c.std
    words = [event.event for event in names['found'].events]
    assert words.index('escaping') < words.index('limit_cycle')
    assert capsys.readouterr().out
