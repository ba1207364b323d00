# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Every code block of README.md and docs/ runs, or says why it cannot.

The blocks of a page run in their order, in one folder: what one writes, the next may read.
"""

from __future__ import annotations

import doctest
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest
import ros_domain  # noqa: F401 - for the players that the pages start
import yaml
from code_blocks import PAGES, ROOT, Block, blocks_in, page_name
from page_data import BAGS, bags_needed, write_sets
from shared_files import made_once

from kitti_ros2.importer.plan import parse_plan
from kitti_ros2.options.table import make_settings

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.programs

SHELLS = ('sh', 'bash')
TEXTS = ('text', 'bibtex')
"""Languages of what is shown, not run."""
NOT_RUN = {
    'README.md': 6,
    'docs/howto/argoverse2.md': 3,
    'docs/howto/bags.md': 1,
    'docs/howto/clusters.md': 6,
    'docs/howto/get.md': 1,
    'docs/howto/kitti.md': 1,
    'docs/howto/live.md': 5,
    'docs/howto/look.md': 3,
    'docs/howto/nuscenes.md': 2,
    'docs/howto/odometry.md': 2,
    'docs/howto/play.md': 8,
    'docs/howto/remote.md': 2,
    'docs/howto/remote_outputs.md': 2,
    'docs/howto/ros.md': 6,
    'docs/howto/split.md': 1,
    'docs/howto/stacks.md': 3,
    'docs/howto/waymo.md': 1,
    'docs/index.md': 1,
    'docs/performance.md': 2,
    'docs/tutorials/convert.md': 1,
    'docs/tutorials/foxglove.md': 4,
    'docs/tutorials/robot.md': 2,
    'docs/tutorials/rviz.md': 4,
}
"""By page the number of blocks that cannot run in a test."""
PATIENCE_S = 300


def blocks_of(page: Path) -> list[Block]:
    return blocks_in(page.read_text('utf-8'))


@pytest.fixture(scope='session')
def data_sets(tmp_path_factory):
    return made_once(tmp_path_factory, 'page_data', write_sets)


@pytest.fixture
def folder(data_sets, tmp_path, monkeypatch):
    """A folder with the data sets, in which commands run with a home of their own."""
    shutil.copytree(data_sets, tmp_path / 'data')
    (tmp_path / 'bin').mkdir()
    for name, words in (('kitti-ros2', '-m kitti_ros2'), ('python', ''), ('python3', '')):
        program = tmp_path / 'bin' / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
        program.chmod(0o755)
    monkeypatch.setenv('PATH', f'{tmp_path / "bin"}{os.pathsep}{os.environ["PATH"]}')
    monkeypatch.setenv('HOME', str(tmp_path))
    monkeypatch.setenv('PYTHONPATH', str(ROOT))
    monkeypatch.chdir(tmp_path / 'data')
    (tmp_path / 'data' / 'config').symlink_to(ROOT / 'config')
    return tmp_path / 'data'


def run_shell(text: str) -> None:
    done = subprocess.run(
        ['bash', '-e', '-o', 'pipefail', '-c', text],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def run_python(text: str, names: dict[str, object], where: str) -> None:
    if '>>> ' not in text:
        exec(compile(text, where, 'exec'), names)
        return
    test = doctest.DocTestParser().get_doctest(text, names, where, where, 0)
    said: list[str] = []
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    doctest.DocTestRunner(optionflags=flags).run(test, out=said.append, clear_globs=False)
    assert said == []
    names.update(test.globs)


def read_yaml(text: str, path: Path) -> None:
    """Read it as what it is: a plan, parameters, QoS overrides, or a file for --config."""
    path.write_text(text, encoding='utf-8')
    values = yaml.safe_load(text)
    if 'reference' in values:
        parse_plan(text, path)
    elif next(iter(values)).startswith('/'):
        qos = pytest.importorskip('kitti_ros2.player.outlets', exc_type=ImportError)
        qos.load_overrides(path)
    elif 'kitti_player' in values:
        parameters = pytest.importorskip('kitti_ros2.player.node', exc_type=ImportError)
        parameters.to_parameters(values['kitti_player']['ros__parameters'])
    else:
        make_settings(values)


def run_block(block: Block, names: dict[str, object], folder: Path, where: str) -> None:
    print(f'{where}\n{block.text}')  # what pytest shows of a failure
    if block.language in SHELLS:
        run_shell(block.text)
    elif block.language in ('python', 'pycon'):
        run_python(block.text, names, where)
    elif block.language == 'yaml':
        read_yaml(block.text, folder / (block.title or 'block.yaml'))
    elif block.language == 'json':
        json.loads(block.text)
    else:
        assert block.language in TEXTS, f'no way to run {block.language!r}'


def needs_rclpy(block: Block) -> bool:
    return any(
        line.startswith('kitti-ros2 play') and '--foxglove' not in line
        for line in block.text.splitlines()
    )


def needs_evo(block: Block) -> bool:
    return 'eval odometry' in block.text or 'evaluate_odometry' in block.text


def needs_trackeval(block: Block) -> bool:
    return 'eval tracking' in block.text or 'evaluate_tracking' in block.text


NEEDS = {'rclpy': needs_rclpy, 'evo': needs_evo, 'trackeval': needs_trackeval}
"""By package, which is not everywhere installed: whether a block needs it."""


@pytest.mark.one_in(3)
@pytest.mark.parametrize('page', PAGES, ids=page_name)
def test_blocks_of_a_page_run(page, folder):
    blocks = [each for each in blocks_of(page) if not each.reason]
    commands = '\n'.join(each.text for each in blocks if each.language in (*SHELLS, 'python'))
    for name in bags_needed(commands):
        BAGS[name](folder / name, folder)
    names: dict[str, object] = {'__name__': '__main__'}
    absent = [name for name in NEEDS if importlib.util.find_spec(name) is None]
    skipped = [each for each in blocks if any(NEEDS[name](each) for name in absent)]
    for block in blocks:
        if block not in skipped:
            run_block(block, names, folder, f'{page_name(page)}:{block.line}')
    if skipped:
        pytest.skip(f'{len(skipped)} blocks need {" or ".join(absent)}')


def test_blocks_that_are_not_run_are_few():
    counts = {page_name(page): sum(bool(b.reason) for b in blocks_of(page)) for page in PAGES}
    assert {name: count for name, count in counts.items() if count} == NOT_RUN


def test_blocks_are_found_with_their_language_and_reason():
    text = """Text.

```sh
a
```

- item

    <!-- not run: a window -->
    ```python
    b
      c
    ```

<!-- generated: file c.py -->

```python title="c.py"
c
```

<!-- end -->

```yaml title="a.yaml" hl_lines="1"
d: 1
```
"""
    assert blocks_in(text) == [
        Block('sh', 'a\n', 3),
        Block('python', 'b\n  c\n', 10, 'a window'),
        Block('yaml', 'd: 1\n', 23, title='a.yaml'),
    ]


def test_a_block_that_fails_is_named(tmp_path):
    with pytest.raises(AssertionError, match='Oh no'):
        run_shell('echo "Oh no" >&2; false; true')
    with pytest.raises(AssertionError, match='Expected'):
        run_python('>>> 1 + 1\n3\n', {}, 'page')
    with pytest.raises(Exception, match='unknown option'):
        read_yaml('no_such_option: 1', tmp_path / 'block.yaml')
