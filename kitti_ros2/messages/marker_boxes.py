# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The cubes of any visualization_msgs/MarkerArray -> boxes in velo_link.

Markers are drawn for people: the class of a box is in a caption, in a namespace, or missing.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections import Counter
from itertools import islice, takewhile
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from ..model.boxes import Cuboid
from .detections import place_in_velo, placed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.geometry import Transform

AS_LINES = 'drawn as lines or lists of cubes'

_CUBE = 1
_LINE_LIST = 5
_CUBE_LIST = 6
_TEXT = 9
_ADD = 0
_DELETE = 2
_DELETE_ALL = 3
_EGO = 'ego'

_CLASS = re.compile(r'\(?[^\W\d_][\w.-]+\)?')
_SCORE = re.compile(r'(?<![\w.-])(0?\.\d+|1\.0*|\d{1,3}(?=%))(%?)(?![\w.]| ?m)', re.ASCII)
_EDGES = ':;,.#"\'[]{}'
_GENERIC = re.compile(
    r'all|(annot|detect|track|visual)\w*|(b|bounding)_?box(es)?|bounding|box(es)?|basic|class'
    r'|(cube|cuboid|label|marker|object|obstacle|shape)s?|default|id|name|namespace|ns|obj|rviz'
    r'|text|type|unknown|viz'
)


def cuboids_of_markers(
    message: Any,  # noqa: ANN401 - of the bag's types
    to_velo: Mapping[str, Transform],
    *,
    scores: bool = False,
) -> tuple[list[Cuboid], list[str]]:
    """Decode the cubes of a visualization_msgs/MarkerArray; also why others were skipped.

    A cube in namespace ego is the recording car. Boxes drawn as lines, and lists of cubes, are not
    supported and skipped, except for those that frame a cube of the same id.

    Args:
        message: Of the bag's own types.
        to_velo: velo_T_frame by frame name.
        scores: Whether to read scores from the captions: car 0.87, or car 87%.

    Raises:
        ValueError: All boxes are in frames that are not joined.
    """
    shown = _shown(message)
    captions = _Captions(shown)
    cubes = [each for each in shown if each.type == _CUBE]
    framed = {cube.id for cube in cubes}
    lists = [
        each for each in shown if each.type in {_LINE_LIST, _CUBE_LIST} and each.id not in framed
    ]

    def make(cube: Any) -> Cuboid:  # noqa: ANN401 - as above
        return Cuboid(
            _class_of(cube, captions),
            f'{cube.ns}/{cube.id}',
            place_in_velo(cube.pose, cube.header.frame_id, to_velo),
            (cube.scale.x, cube.scale.y, cube.scale.z),
            _score_of(cube, captions) if scores else None,
        )

    cuboids, left_out = placed(cubes, make)
    return cuboids, left_out + [AS_LINES] * len(lists)


def frames_of_markers(message: Any) -> set[str]:  # noqa: ANN401 - of the bag's types
    """Return the frames of the cubes that cuboids_of_markers decodes, without leading slashes."""
    return {each.header.frame_id.lstrip('/') for each in _shown(message) if each.type == _CUBE}


def _shown(message: Any) -> list[Any]:  # noqa: ANN401 - of the bag's types
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


class _Captions:
    """The texts about the cubes of an array, looked up by id and namespace.

    Args:
        shown: The visible markers.
    """

    def __init__(self, shown: list[Any]) -> None:
        self._cubes = Counter(each.id for each in shown if each.type == _CUBE)
        self._texts: dict[int, list[tuple[str, int, str]]] = {}
        for place, each in enumerate(shown):
            if each.type == _TEXT:
                self._texts.setdefault(each.id, []).append((each.ns, place, each.text))
        for texts in self._texts.values():
            texts.sort()

    def of(self, cube: Any) -> list[str]:  # noqa: ANN401 - of the bag's types
        """Return the texts about a cube.

        They are its own text, and those of text markers with its id whose namespace begins with
        the cube's, or of all if the cube is the only one with this id; as they were shown.
        """
        texts = self._texts.get(cube.id, [])
        near = self._in_namespace(texts, cube.ns) if cube.ns else []
        if not near and self._cubes[cube.id] == 1:
            near = texts
        return [cube.text, *(text for _, _, text in sorted(near, key=itemgetter(1)))]

    @staticmethod
    def _in_namespace(
        texts: list[tuple[str, int, str]], namespace: str
    ) -> list[tuple[str, int, str]]:
        """Return those whose namespace begins so; sorted by it, they follow each other."""
        following = islice(texts, bisect_left(texts, (namespace,)), None)
        return list(takewhile(lambda each: each[0].startswith(namespace), following))


def _class_of(cube: Any, captions: _Captions) -> str:  # noqa: ANN401 - of the bag's types
    """Return the class of a cube, empty if unknown.

    It is in a caption, or it is the cube's namespace.
    """
    candidates = [*captions.of(cube), cube.ns.rpartition('/')[2]]
    return next((found for text in candidates if (found := _class_in(text))), '')


def _score_of(cube: Any, captions: _Captions) -> float | None:  # noqa: ANN401 - of the bag's types
    """Return the last fraction or percentage in the captions of a cube, None without one."""
    found = [match for text in captions.of(cube) for match in _SCORE.finditer(text)]
    if not found:
        return None
    number = float(found[-1][1])
    return number / 100 if found[-1][2] else number


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
