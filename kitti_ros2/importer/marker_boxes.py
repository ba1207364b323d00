# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The visible markers of a visualization_msgs/MarkerArray, and the classes of its cubes.

Markers are drawn for people: the class of a box is in a caption, in a namespace, or missing.
"""

from __future__ import annotations

import re
from typing import Any

_LINE_LIST = 5
_CUBE_LIST = 6
_TEXT = 9
_ADD = 0
_DELETE = 2
_DELETE_ALL = 3
_EGO = 'ego'

_CLASS = re.compile(r'\(?[^\W\d_][\w-]+\)?')
_EDGES = ':;,.#"\'[]{}'
_GENERIC = re.compile(
    r'all|(annot|detect|track|visual)\w*|(b|bounding)_?box(es)?|bounding|box(es)?|basic|class'
    r'|(cube|cuboid|label|marker|object|obstacle|shape)s?|default|id|name|namespace|ns|obj|rviz'
    r'|text|type|unknown|viz'
)


def shown_markers(message: Any) -> list[Any]:  # noqa: ANN401 - of the bag's types
    """Return the visible markers after an array, if none were visible before.

    Those of namespace ego are the recording car, not an object, and excluded.
    """
    shown: dict[tuple[str, int], Any] = {}
    for marker in message.markers:
        if marker.action == _DELETE_ALL:
            shown.clear()
        elif marker.action == _DELETE:
            shown.pop((marker.ns, marker.id), None)
        elif marker.action == _ADD:
            shown[marker.ns, marker.id] = marker
    return [marker for (namespace, _), marker in shown.items() if namespace != _EGO]


def is_list(marker: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Whether a marker draws boxes as edges, or several cubes."""
    return marker.type in {_LINE_LIST, _CUBE_LIST}


def class_of_marker(cube: Any, shown: list[Any]) -> str:  # noqa: ANN401 - of the bag's types
    """Return the class of a cube, empty if unknown.

    It is in the cube's own text, or in a text marker with the cube's id (its namespace begins with
    the cube's, or the cube is the only one with this id), or it is the cube's namespace.
    """
    texts = [each for each in shown if each.type == _TEXT and each.id == cube.id]
    near = [each for each in texts if cube.ns and each.ns.startswith(cube.ns)]
    if not near and sum(each.type == cube.type and each.id == cube.id for each in shown) == 1:
        near = texts
    candidates = [cube.text, *(each.text for each in near), cube.ns.rpartition('/')[2]]
    return next((found for text in candidates if (found := _class_in(text))), '')


def _class_in(text: str) -> str:
    """Return the words of a caption up to its first number: Person (sitting) 5, car: 0.87."""
    words: list[str] = []
    for token in text.partition('\n')[0].split():
        word = token.strip(_EDGES)
        if any(character.isdigit() for character in word):
            break
        if _CLASS.fullmatch(word) and not _is_generic(word):
            words.append(word)
    return ' '.join(words)


def _is_generic(word: str) -> bool:
    return all(_GENERIC.fullmatch(part) for part in word.lower().split('_') if part)
