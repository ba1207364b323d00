# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The notebook of the tutorials runs, and its page shows the same cells."""

from __future__ import annotations

import json

import pytest
from code_blocks import ROOT, blocks_in

pytestmark = pytest.mark.programs

NOTEBOOK = ROOT / 'docs' / 'tutorials' / 'notebook.ipynb'
PAGE = NOTEBOOK.with_suffix('.md')


def read_cells() -> list[str]:
    cells = json.loads(NOTEBOOK.read_text('utf-8'))['cells']
    return [''.join(cell['source']) for cell in cells if cell['cell_type'] == 'code']


def test_the_notebook_runs(tmp_path, monkeypatch):
    nbformat = pytest.importorskip('nbformat', reason='no nbclient: install the extra docs')
    nbclient = pytest.importorskip('nbclient', reason='no nbclient: install the extra docs')
    pytest.importorskip('ipykernel', reason='no ipykernel: install the extra docs')
    monkeypatch.setenv('PYTHONPATH', str(ROOT))
    monkeypatch.setenv('TMPDIR', str(tmp_path))  # where the notebook writes
    monkeypatch.setenv('IPYTHONDIR', str(tmp_path / 'ipython'))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    resources = {'metadata': {'path': str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=300, resources=resources).execute()
    outputs = [each for cell in notebook.cells for each in cell.get('outputs', [])]
    assert sum('image/png' in each.get('data', {}) for each in outputs) == 2
    said = ''.join(each.get('text', '') for each in outputs)
    assert 'same points: True' in said
    assert 'same files: True' in said


def test_the_notebook_is_kept_without_outputs():
    cells = json.loads(NOTEBOOK.read_text('utf-8'))['cells']
    assert [cell for cell in cells if cell.get('outputs') or cell.get('execution_count')] == []


def test_the_page_shows_the_cells_of_the_notebook():
    blocks = blocks_in(PAGE.read_text('utf-8'))
    shown = [block.text.rstrip('\n') for block in blocks if block.language == 'python']
    assert shown == read_cells()
