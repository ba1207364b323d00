# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules for outputs, apart from their staging: which --overwrite may replace, and JSON text.

The command line needs both before it writes anything, and so nothing heavy is imported here.
"""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..model.bag_formats import CONTAINERS

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

    from ..model.errors import Loss

    Refusal = Callable[[Path], str | None]


# Values as JSON text.


def json_text(values: object) -> str:
    """Return values as one JSON document; NaN and infinite numbers are null, paths are text."""
    return json.dumps(_finite(values), default=_json_value, indent=2) + '\n'


def losses_json(losses: Iterable[Loss]) -> list[dict[str, object]]:
    """Return losses with their texts, for json_text."""
    return [{'stream': loss.stream, 'count': loss.count, 'message': loss.text()} for loss in losses]


def _finite(value: Any) -> Any:  # noqa: ANN401 - any value of JSON
    """Return the value with null for NaN and infinite numbers, which JSON does not support."""
    if isinstance(value, dict):
        return {key: _finite(member) for key, member in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(member) for member in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def _json_value(value: object) -> str:
    if isinstance(value, Path):
        return str(value)
    raise TypeError(type(value))


# Refusals for Staging: which existing outputs --overwrite may replace.

_NO_BAG = 'it is no bag, so --overwrite does not touch it; choose another name'
_IN_FILE = [kind for kind in CONTAINERS.values() if kind.in_file]
_MAGICS = tuple(kind.magic for kind in _IN_FILE)
_DIRECTORY_FILES = (
    *(suffix for kind in CONTAINERS.values() for suffix in (kind.suffix, *kind.side_suffixes)),
    '.zstd',
)
_WITHOUT_METADATA = tuple(kind.suffix for kind in CONTAINERS.values() if not kind.in_rosbag2)


def keep_all_but_bags(path: Path) -> str | None:
    """Return why --overwrite does not replace a path; None for a bag."""
    return None if _looks_like_bag(path) else _NO_BAG


def refusal_of(keep: Refusal, *, overwrite: bool) -> Refusal:
    """Return a refusal for Staging; without --overwrite it names that option where it helps.

    Args:
        keep: Returns why --overwrite does not replace a path, None if it does.
        overwrite: Whether it is given.
    """
    advice = None if overwrite else 'choose another name, or pass --overwrite'
    return lambda path: keep(path) or advice


def keep_all_but_files(what: str, beginnings: Collection[bytes]) -> Refusal:
    """Return a refusal for Staging that lets only files of one kind be replaced.

    Args:
        what: The kind as messages name it, such as picture.
        beginnings: First bytes of such files; empty files may be replaced as well.
    """

    def refusal(path: Path) -> str | None:
        if path.is_file():
            with path.open('rb') as file:
                head = file.read(max(map(len, beginnings))).lower()
            if not head or any(head.startswith(beginning.lower()) for beginning in beginnings):
                return None
        return f'it is no {what}, so --overwrite does not touch it; choose another name'

    return refusal


KEEP_ALL_BUT_PAGES = keep_all_but_files('HTML page', [b'<!doctype html'])
KEEP_ALL_BUT_JSON = keep_all_but_files('JSON file', [b'{'])


def _looks_like_bag(path: Path) -> bool:
    if path.is_file():
        with path.open('rb') as file:
            head = file.read(max(map(len, _MAGICS)))
        has_suffix = path.suffix in {kind.suffix for kind in _IN_FILE}
        return has_suffix and (not head or head.startswith(_MAGICS))
    if not path.is_dir():
        return False
    names = set()
    for entry in path.iterdir():
        if entry.is_symlink() or not entry.is_file():
            return False
        names.add(entry.name)
    files = {name for name in names if name.endswith(_DIRECTORY_FILES)}
    if names - files - {'metadata.yaml'}:
        return False
    # A split ROS 1 bag has no metadata.yaml; an empty directory may be replaced as well.
    return 'metadata.yaml' in names or all(name.endswith(_WITHOUT_METADATA) for name in names)
