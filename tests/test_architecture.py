# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The rooms of the package and who may enter them, asserted on the source text with ast."""

from __future__ import annotations

import ast
import re
from collections import Counter, defaultdict
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = 'kitti_ros2'
SOURCE = Path(__file__).resolve().parents[1] / PACKAGE

# Each room and the rooms it imports: no more, no fewer. A room is a sub-package of kitti_ros2.
_IMPORTS = {
    '': 'model api',
    'model': '',
    'files': 'model',
    'options': 'model files',
    'drawing': 'model options',
    'kitti': 'model files options',
    'messages': 'model files options drawing',
    'synthetic': 'model files kitti',
    'bags': 'model files options kitti messages',
    'importer': 'model files options drawing kitti messages bags',
    'own_bags': 'model files options kitti messages bags importer',
    'pictures': 'model files options drawing kitti messages bags importer own_bags',
    'player': 'model files options kitti messages bags importer own_bags',
    'report': 'model options drawing kitti messages bags importer own_bags pictures'
    ' datasets evaluation',
    'viewers': 'model options drawing messages player',
    'validation': 'model files options kitti messages bags',
    'api': 'model files options drawing kitti messages bags importer own_bags pictures',
    'datasets': 'model files options drawing kitti messages bags own_bags pictures api validation',
    'batch': 'model files options kitti bags own_bags validation datasets report evaluation',
    'evaluation': 'model files options drawing kitti messages bags importer own_bags pictures'
    ' player api',
}
ROOMS = {room: frozenset(others.split()) for room, others in _IMPORTS.items()}
ROOMS['cli'] = frozenset(ROOMS)
ROOMS['__main__'] = frozenset({'cli'})

# Each guest from outside and the rooms, or modules, it may be seen in.
GUESTS = {
    'rclpy': {
        'player.middleware',
        'player.node',
        'player.outlets',
        'player.run',
    },
    'rosbags': {'messages', 'bags'},
    'mcap': {'messages', 'bags'},
    'distributed': {'batch'},
    'foxglove': {'viewers.foxglove_server'},
    'websockets': {'viewers.foxglove_proxy'},
    'fsspec': {'files'},
    'evo': {'evaluation'},
    'cv2': {'drawing', 'files', 'messages', 'pictures', 'report', 'synthetic'},
    'httpx': {'datasets.download_sources'},
    'jinja2': {'report'},
    'matplotlib': {'datasets', 'drawing', 'evaluation'},
    'rerun': {'viewers.rerun_archetypes', 'viewers.rerun_show'},
    'trackeval': {'evaluation'},
    'typer': {'cli'},
    'rich': {'cli'},
}

FORBIDDEN_NAMES = {'util', 'utils'}
VAGUE_NAMES = {'each', 'found', 'known'}
METAPHORS = {
    'complain', 'complaint', 'complaints', 'contract', 'glance', 'oddities',
    'oddity', 'outbox', 'outlook', 'relay', 'remark', 'remarks', 'told',
}  # fmt: skip


@dataclass(frozen=True)
class Import:
    """One imported name: where it stands, and the module that it comes from."""

    importer: str
    line: int
    target: str


def modules(source: Path) -> dict[str, Path]:
    """Map each dotted module name of the package folder to its file."""
    found = {}
    for path in sorted(source.rglob('*.py')):
        parts = path.relative_to(source.parent).with_suffix('').parts
        found['.'.join(parts[:-1] if parts[-1] == '__init__' else parts)] = path
    return found


def imports(name: str, path: Path, known: set[str]) -> list[Import]:
    """List every import of a module, also those in functions and under TYPE_CHECKING."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'), str(path))):
        if isinstance(node, ast.Import):
            found += [Import(name, node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = _absolute(name, path, node)
            for alias in node.names:
                inner = f'{base}.{alias.name}'
                found.append(Import(name, node.lineno, inner if inner in known else base))
    return found


def _absolute(name: str, path: Path, node: ast.ImportFrom) -> str:
    if not node.level:
        return node.module or ''
    package = name.split('.') if path.stem == '__init__' else name.split('.')[:-1]
    package = package[: len(package) - node.level + 1]
    return '.'.join([*package, *([node.module] if node.module else [])])


def room_of(module: str) -> str:
    """Name the room that a module of the package belongs to ('' is the package itself)."""
    return [*module.split('.'), ''][1]


def violations(source: Path) -> list[str]:
    """Name every breach of the rules in a package folder."""
    files = modules(source)
    found = [found for name in files if (found := _misnamed(name))]
    graph: dict[str, set[str]] = {}
    for name, path in files.items():
        entries = imports(name, path, set(files))
        found += [breach for entry in entries if (breach := _breach(entry))]
        graph[name] = {entry.target for entry in entries if entry.target in files} - {name}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        found.append('circular import: ' + ' -> '.join(error.args[1]))
    return list(dict.fromkeys(found))


def _misnamed(name: str) -> str | None:
    if FORBIDDEN_NAMES & set(name.split('.')):
        return f'{name}: a room for anything; name it by the question it answers'
    if room_of(name) not in ROOMS:
        return f'{name}: a room that ROOMS does not know; give it its place there'
    return None


def _breach(entry: Import) -> str | None:
    room = room_of(entry.importer)
    where = f'{entry.importer}:{entry.line}: imports {entry.target}'
    top = entry.target.split('.')[0]
    if top != PACKAGE:
        places = GUESTS.get(top, {room})
        here = {room, entry.importer.removeprefix(f'{PACKAGE}.')}
        return None if here & places else f'{where}; only {" and ".join(sorted(places))} may'
    target = room_of(entry.target)
    if not {room, target} <= set(ROOMS):
        return None  # said once, by _misnamed
    if target in {room, ''} or target in ROOMS[room]:
        return None
    return f'{where}; {room or PACKAGE} may not import {target}'


def test_package_keeps_the_rules() -> None:
    assert (SOURCE / 'model/errors.py').is_file(), 'the check looks at the wrong folder'
    assert violations(SOURCE) == []


def test_rooms_are_a_strict_order() -> None:
    """Nobody may import a room that may, directly or not, import him."""
    TopologicalSorter(ROOMS).prepare()
    assert not any('cli' in allowed for room, allowed in ROOMS.items() if room != '__main__')
    assert [room for room, allowed in ROOMS.items() if 'pictures' in allowed] == [
        'report',
        'api',
        'datasets',
        'evaluation',
        'cli',
    ]
    assert 'messages' not in ROOMS['kitti']
    assert 'kitti' not in ROOMS['messages']


def test_rooms_import_what_they_are_said_to() -> None:
    files = modules(SOURCE)
    seen = {
        (room_of(name), room_of(entry.target))
        for name, path in files.items()
        for entry in imports(name, path, set(files))
        if entry.target.split('.')[0] == PACKAGE
    }
    unused = {(room, other) for room, others in ROOMS.items() for other in others} - seen
    assert {(room, other) for room, other in unused if room not in {'cli', '__main__'}} == set()


def test_class_names_are_used_once() -> None:
    """A leading underscore does not make another name."""
    places = defaultdict(list)
    for name, path in modules(SOURCE).items():
        for node in ast.parse(path.read_text(encoding='utf-8')).body:
            if isinstance(node, ast.ClassDef):
                places[node.name.lstrip('_')].append(name)
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def bound_names(tree: ast.AST) -> set[str]:
    """Return the names of a module's functions, classes, parameters and variables."""
    fields = {
        id(node.target)
        for holder in ast.walk(tree)
        if isinstance(holder, ast.ClassDef)
        for node in holder.body
        if isinstance(node, ast.AnnAssign)
    }
    names = set()
    for node in ast.walk(tree):
        if id(node) in fields:
            continue
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.arg):
            names.add(node.arg)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
    return names


def test_names_are_words_of_the_field() -> None:
    """A loop runs over topics or frames, never over each; a line to users is a note."""
    wrong = [
        f'{path.relative_to(SOURCE)}: {name}'
        for path in SOURCE.rglob('*.py')
        for name in bound_names(ast.parse(path.read_text(encoding='utf-8')))
        if name in VAGUE_NAMES
        or METAPHORS & set(re.sub('([a-z])([A-Z])', r'\1_\2', name).lower().split('_'))
    ]
    assert wrong == []


def test_few_file_names_are_used_in_two_rooms() -> None:
    names = Counter(path.name for path in modules(SOURCE).values())
    del names['__init__.py']
    twice = [name for name, count in names.items() if count > 1]
    assert len(twice) <= 8, twice
    assert not [name for name, count in names.items() if count > 2]


def test_the_page_names_files_and_rooms_that_exist() -> None:
    page = (SOURCE.parent / 'ARCHITECTURE.md').read_text(encoding='utf-8')
    named = re.findall(r'`([a-z_0-9]+/[a-z_0-9]*(?:\.py)?)`', page)
    assert len(named) > 50
    folders = SOURCE, SOURCE.parent
    assert [name for name in named if not any((each / name).exists() for each in folders)] == []
    rooms = re.findall(r'^\| `([a-z_]+)/` \|', page, re.MULTILINE)
    assert sorted(rooms) == sorted(set(ROOMS) - {'', '__main__'})


def test_layouts_are_compared_in_kitti_only() -> None:
    """Other rooms ask Layout.traits, so that a new layout changes none of them."""
    found = [
        f'{name}:{node.lineno}'
        for name, path in modules(SOURCE).items()
        if room_of(name) != 'kitti'
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(node, ast.Compare)
        and any('Layout.' in ast.unparse(side) for side in [node.left, *node.comparators])
    ]
    assert found == []


def make_package(folder: Path, **files: str) -> Path:
    """Write a package of the same name; a double underscore in a key stands for a slash."""
    source = folder / PACKAGE
    for name, text in {'__init__': '', **files}.items():
        path = source / (name if name == '__init__' else name.replace('__', '/', 1))
        path.parent.mkdir(parents=True, exist_ok=True)
        (path.parent / '__init__.py').touch()
        path.with_suffix('.py').write_text(text, encoding='utf-8')
    return source


def test_checker_accepts_what_is_allowed(tmp_path: Path) -> None:
    source = make_package(
        tmp_path,
        model__errors='',
        model__samples='from .errors import KittiRos2Error',
        kitti__raw='import numpy as np\nfrom ..model.samples import Scan',
        messages__scan='import cv2\nfrom rosbags.typesys import get_typestore',
        bags__write='import mcap.writer\nfrom kitti_ros2.messages import scan',
        cli__to_bag='def main():\n    from kitti_ros2.bags.write import write\n    import rich',
    )
    assert violations(source) == []


@pytest.mark.parametrize(
    ('files', 'complaint'),
    [
        ({'model__errors': 'from ..bags import a', 'bags__a': ''}, 'model may not import bags'),
        ({'kitti__raw': 'from ..messages import scan'}, 'kitti may not import messages'),
        ({'messages__scan': 'import kitti_ros2.kitti.readers'}, 'messages may not import kitti'),
        ({'messages__a': 'def f():\n    from ..bags import write'}, 'messages may not import bags'),
        ({'importer__a': 'from ..own_bags import a'}, 'importer may not import own_bags'),
        ({'synthetic__a': 'from kitti_ros2.bags import x'}, 'synthetic may not import bags'),
        ({'player__node': 'from ..pictures import bev'}, 'player may not import pictures'),
        ({'own_bags__a': 'from ..cli import progress'}, 'own_bags may not import cli'),
        ({'__init__': 'from .bags import a', 'bags__a': ''}, f'{PACKAGE} may not import bags'),
        (
            {'player__session': 'import rclpy.node'},
            'only player.middleware and player.node',
        ),
        ({'kitti__png': 'import cv2'}, 'only drawing and files and messages and pictures and'),
        ({'own_bags__a': 'from rosbags.rosbag2 import Reader'}, 'only bags and messages may'),
        ({'own_bags__a': 'import foxglove'}, 'only viewers.foxglove_server may'),
        ({'player__run': 'from ..viewers import websocket'}, 'player may not import viewers'),
        ({'bags__write': 'from rich.progress import Progress'}, 'only cli may'),
        ({'cli__view': 'import rerun as rr'}, 'only viewers.rerun_archetypes and'),
        ({'kitti__utils': ''}, 'a room for anything'),
        ({'helpers': ''}, 'a room that ROOMS does not know'),
        ({'kitti__a': 'from . import b', 'kitti__b': 'from .a import f'}, 'circular import'),
        (
            {'kitti____init__': 'from .a import f', 'kitti__a': 'from kitti_ros2.kitti import g'},
            'circular import',
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else '',
)
def test_checker_sees_a_violation(files: dict[str, str], complaint: str, tmp_path: Path) -> None:
    found = violations(make_package(tmp_path, **files))
    assert len(found) == 1
    assert complaint in found[0]
