# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI-360's 3D boxes, data_3d_bboxes/{train,train_full}/DRIVE.xml, and those of a frame.

The root is opencv_storage; each of its children is an object:

- label: a word; semanticId: its number, the kittiId of the label table, not the id of images
- instanceId: with the label's id it makes the value of instance images, id * 1000 + instanceId
- start_frame, end_frame: the part of the drive, of 200 m, that it was annotated in; it may be seen
  from others, and not from all of these
- timestamp: the frame of a moving object, which has an object a frame; -1 of one that stands
- transform: (4, 4), to the world of poses.txt, with the size as its scale
- vertices, faces: a mesh; that of a box is the unit cube, x ahead, y to the left, z up
- a matrix has rows, cols, dt and data, numbers between blanks and line ends

Objects of drive 0004 in train_full have dynamic and dynamicSeq in place of the numbers. Sources:
annotation.py and labels.py of kitti360Scripts, its issues 6, 103, 130 and 135, and py123d for 0004.
**No file of the data set was at hand**: this is not proved on real ones.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..model.boxes import Cuboid, count_points
from ..model.classes import KITTI_360_LABELS
from ..model.errors import BadFileError, shown
from ..model.geometry import Transform
from .text_file import check_count, parse_numbers
from .tracklet_file import XmlParser

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array, Int64Array

LEAST_POINTS = 5
"""The points of a frame's scan in a box from which on the box is one of the frame."""
REACH_M = 85.0
"""The scanner's, 80.006 m in 70 scans, with its distance from the GPS/IMU."""

_EXPECTED = 'an XML of KITTI-360, opencv_storage with objects'
_ROOT = 'opencv_storage'
_MATRICES = ('transform', 'vertices')
_PARTS = ('rows', 'cols', 'data')
_INSTANCES = 1000
_UNNAMED = 1_000_000
"""Track ids from here on are of objects without one of their own, by their position in the file."""
_STANDS = -1
_CORNERS = 8
_MOST = 10**9
"""The limit of ids and frames, so that tracks are int32, and of coordinates in metres."""
_SHEAR = 1e-3
_BLOCK = 256

CLASSES = {
    'car': 'Car',
    'truck': 'Truck',
    'person': 'Pedestrian',
    'pedestrian': 'Pedestrian',
    'train': 'Tram',
}
"""Labels that mean what a class of KITTI means. A rider is no Cyclist, which has the bicycle in its
box, nor is a bicycle: all others keep their names."""


@dataclass(frozen=True, eq=False)
class WorldBox:
    """A box in the world of poses.txt: x east, y north, z up, metres.

    Attributes:
        class_name: KITTI's class, or the label where KITTI has none.
        label: KITTI-360's.
        track_id: The value of its pixels in instance images, id * 1000 + instanceId; from 1,000,000
            on where it has none, by its position in the file.
        world_T_box: Its own frame: origin in the middle, x ahead, y to the left, z up.
        size_lwh: Length, width, height along x, y, z, metres.
        window: First and last frame of the part of the drive that it was annotated in, None if the
            file has none.
        frame: The frame of a moving object, None for one that stands.
    """

    class_name: str
    label: str
    track_id: int
    world_T_box: Transform
    size_lwh: tuple[float, float, float]
    window: tuple[int, int] | None = None
    frame: int | None = None


class BoxFile(NamedTuple):
    """The content of a file of boxes.

    Attributes:
        boxes: In the order of the file.
        errors: Of the invalid ones.
        shapes: Number of objects that are no boxes, by label; '' for those without a transform.
    """

    boxes: list[WorldBox]
    errors: list[BadFileError]
    shapes: Counter[str]


def parse_world_boxes(data: bytes, path: Path | str) -> BoxFile:
    """Parse a file of boxes.

    Raises:
        BadFileError: The XML is truncated, too large or another, or defines entities; or more than
            a thousand objects are invalid.
    """
    parser = _BoxParser(path)
    parser.read(data)
    if parser.root != _ROOT:
        raise BadFileError(path, f'a root {shown(parser.root)}', _EXPECTED)
    return parser.file


class _BoxParser(XmlParser):
    """Parses objects, one after the other."""

    def __init__(self, path: Path | str) -> None:
        super().__init__(path, _EXPECTED)
        self.file = BoxFile([], [], Counter())
        self.root = ''
        self._object: dict[str, str] = {}
        self._count = 0
        self._tracks: set[tuple[int, int]] = set()

    def _take(self, name: str) -> None:
        depth = len(self._open)
        if depth == 1:
            self.root = name
        elif depth == 2:
            self._end_object()
        elif name in _PARTS and self._open[2] in _MATRICES:
            self._object[f'{self._open[2]} {name}'] = ''.join(self._text)
        elif depth == 3:
            self._object[name] = ''.join(self._text).strip()

    def _end_object(self) -> None:
        values, self._object = self._object, {}
        self._count += 1
        try:
            box = self._box(values)
        except ValueError as error:
            problem = f'{self._open[1]}: {error}'
            line = self._expat.CurrentLineNumber
            self.file.errors.append(BadFileError(self._path, problem, 'a box', line=line))
            check_count(self.file.errors, self._path, _EXPECTED)
        else:
            if box is not None:
                self.file.boxes.append(self._unique(box))

    def _box(self, values: dict[str, str]) -> WorldBox | None:
        """Return the box of an object, None for another shape.

        Raises:
            ValueError: A value is missing or invalid.
        """
        if 'transform data' not in values:
            self.file.shapes[''] += 1
            return None
        label, track_id = _identify(values, _UNNAMED + self._count)
        matrix = _matrix('transform', 4, *(values.get(f'transform {part}', '') for part in _PARTS))
        sides = _sides(*(values.get(f'vertices {part}', '') for part in _PARTS))
        if sides is None:
            self.file.shapes[label] += 1
            return None
        world_t_box, size_lwh = _place(matrix, *sides)
        frame = _whole(values, 'timestamp', _STANDS)
        window = None
        if 'start_frame' in values and 'end_frame' in values:
            window = _whole(values, 'start_frame'), _whole(values, 'end_frame')
            if window[0] > window[1]:
                raise ValueError(f'start_frame {window[0]} after end_frame {window[1]}')
        class_name = CLASSES.get(label, label)
        own_frame = None if frame < 0 else frame
        return WorldBox(class_name, label, track_id, world_t_box, size_lwh, window, own_frame)

    def _unique(self, box: WorldBox) -> WorldBox:
        """Return a box under an id of its own where an earlier one has its id in the same frame."""
        frame = _STANDS if box.frame is None else box.frame
        if (box.track_id, frame) in self._tracks or (box.track_id, _STANDS) in self._tracks:
            box = replace(box, track_id=_UNNAMED + self._count)
        self._tracks.add((box.track_id, frame))
        return box

    def _where(self) -> str:
        return f'{self._open[1]}: ' if len(self._open) > 1 else ''


def _identify(values: dict[str, str], unnamed: int) -> tuple[str, int]:
    """Return the label and the track id of an object."""
    if 'semanticId' in values:
        number = _whole(values, 'semanticId')
        if number not in KITTI_360_LABELS:
            raise ValueError(f'semanticId {number}')
        image_id, label = KITTI_360_LABELS[number]
        instance = _whole(values, 'instanceId', 0)
        return label, image_id * _INSTANCES + instance if instance > 0 else unnamed
    label = values.get('label', '')
    if not label:
        raise ValueError('neither semanticId nor label')
    moving = _whole(values, 'dynamic', 0) and _whole(values, 'dynamicSeq', 0)
    return label, 2 * _UNNAMED + moving if moving else unnamed


def _whole(values: dict[str, str], name: str, default: int | None = None) -> int:
    """Return a whole number of an object.

    Raises:
        ValueError: It is missing without a default, or no whole number.
    """
    if name not in values and default is not None:
        return default
    (value,) = parse_numbers([values.get(name, '')], 1)
    if not value.is_integer() or abs(value) > _MOST:
        raise ValueError(f'{name} {values[name]}')
    return int(value)


def _matrix(name: str, width: int, rows: str, cols: str, data: str) -> Float64Array:
    """Return a matrix, (N, width), of the texts of its parts.

    Raises:
        ValueError: It is missing or of another width.
    """
    words = data.split()
    if cols.strip() != str(width) or rows.strip() != str(len(words) // width):
        raise ValueError(f'{name} of {rows} rows, {cols} columns, {len(words)} values')
    return np.array(parse_numbers(words, len(words) // width * width)).reshape(-1, width)


@lru_cache(maxsize=16)  # all boxes have the same
def _sides(rows: str, cols: str, data: str) -> tuple[Float64Array, Float64Array] | None:
    """Return (3,) the middle and (3,) the extent of vertices, None of another shape than a box.

    Raises:
        ValueError: They are no matrix.
    """
    vertices = _matrix('vertices', 3, rows, cols, data)
    if len(vertices) != _CORNERS:
        return None
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = {*map(tuple, (vertices > (low + high) / 2).tolist())}
    on_sides = np.isclose(vertices, low) | np.isclose(vertices, high)
    is_box = len(corners) == _CORNERS and on_sides.all()
    return ((low + high) / 2, high - low) if is_box else None


def _place(
    matrix: Float64Array, middle: Float64Array, extent: Float64Array
) -> tuple[Transform, tuple[float, float, float]]:
    """Return world_T_box and the size of a mesh whose transform has a scale.

    Raises:
        ValueError: It has no volume, or its axes are not at right angles.
    """
    if max(np.abs(values).max() for values in (matrix, middle, extent)) > _MOST:
        raise ValueError('a coordinate beyond a million kilometres')
    scaled = matrix[:3, :3]
    scale = np.linalg.norm(scaled, axis=0)
    size = extent * scale
    if matrix.shape != (4, 4) or (matrix[3] != (0, 0, 0, 1)).any() or not (size > 0).all():
        raise ValueError('a transform that has no scale, or whose last row is not 0 0 0 1')
    axes = scaled / scale
    if np.abs(axes.T @ axes - np.eye(3)).max() > _SHEAR:
        raise ValueError('a transform whose axes are not at right angles')
    if np.linalg.det(axes) < 0:  # mirrored, which a box does not show
        axes[:, 1] *= -1
    left, _, right = np.linalg.svd(axes)
    length, width, height = size.tolist()
    place = Transform(left @ right, scaled @ middle + matrix[:3, 3])
    return place, (length, width, height)


# A file of boxes, written.

_CUBE = np.array([
    [0.5, 0.5, 0.5], [0.5, 0.5, -0.5], [0.5, -0.5, 0.5], [0.5, -0.5, -0.5],
    [-0.5, 0.5, -0.5], [-0.5, 0.5, 0.5], [-0.5, -0.5, -0.5], [-0.5, -0.5, 0.5],
])  # fmt: skip
_TRIANGLES = np.array([
    [0, 2, 1], [2, 3, 1], [4, 6, 5], [6, 7, 5], [4, 5, 1], [5, 0, 1],
    [7, 6, 2], [6, 3, 2], [5, 7, 0], [7, 2, 0], [1, 3, 4], [3, 6, 4],
])  # fmt: skip
_LABELS_OF = {name: label for label, name in CLASSES.items() if label != 'pedestrian'}
_OTHER_LABELS = {
    'Van': 'car',
    'Cyclist': 'rider',
    'Person_sitting': 'person',
    'Misc': 'unknown object',
}
_NUMBERS = {label: number for number, (_, label) in KITTI_360_LABELS.items()}


def label_of(class_name: str) -> str:
    """Return the label of a class of KITTI, the nearest one, such as car of a van."""
    return {**_LABELS_OF, **_OTHER_LABELS}.get(class_name, class_name)


def format_world_boxes(boxes: Sequence[WorldBox]) -> str:
    """Format a file of boxes; instances are numbered by label in the order of track ids.

    Raises:
        ValueError: A label is none of the data set.
    """
    instances: dict[str, dict[int, int]] = {}
    lines = ['<?xml version="1.0"?>', f'<{_ROOT}>']
    for index, box in enumerate(boxes):
        if box.label not in _NUMBERS:
            raise ValueError(f'{box.label!r} is no label of KITTI-360')
        tracks = instances.setdefault(box.label, {})
        first, last = box.window or (0, 0)
        values = {
            'index': index,
            'label': box.label,
            'semanticId': _NUMBERS[box.label],
            'instanceId': tracks.setdefault(box.track_id, len(tracks) + 1),
            'category': 1,
            'start_frame': first,
            'end_frame': last,
            'timestamp': _STANDS if box.frame is None else box.frame,
        }
        transform = box.world_T_box.matrix()
        transform[:3, :3] *= box.size_lwh
        lines += [f'<object{index}>', *(f'<{key}>{value}</{key}>' for key, value in values.items())]
        for name, matrix in (('transform', transform), ('vertices', _CUBE)):
            lines += _format_matrix(name, matrix, 'f', '.8e')
        lines += [*_format_matrix('faces', _TRIANGLES, 'i', 'd'), f'</object{index}>']
    return '\n'.join([*lines, f'</{_ROOT}>', ''])


def _format_matrix(name: str, matrix: npt.NDArray[Any], kind: str, form: str) -> list[str]:
    rows, columns = matrix.shape
    return [
        f'<{name} type_id="opencv-matrix">',
        f'<rows>{rows}</rows>',
        f'<cols>{columns}</cols>',
        f'<dt>{kind}</dt>',
        '<data>',
        *(' '.join(f'{value:{form}}' for value in row) for row in matrix.tolist()),
        f'</data></{name}>',
    ]


# The boxes of a frame: those with some points of its scan inside.
#
# A standing object is looked for in the frames of its window, and before and after it as long as
# the scanner stays within reach: what stands at another pass may be another car.


class BoxIndex:
    """Finds the boxes of frames.

    Args:
        boxes: Of the recording.
        numbers: (N,) of the frames with a pose, ascending.
        positions: (N, 3) of the vehicle in the world, metres.
    """

    def __init__(
        self, boxes: Sequence[WorldBox], numbers: Int64Array, positions: Float64Array
    ) -> None:
        self._boxes = boxes
        self._middles = np.array([box.world_T_box.translation for box in boxes]).reshape(-1, 3)
        sizes = np.array([box.size_lwh for box in boxes]).reshape(-1, 3)
        self._reaches = REACH_M + np.linalg.norm(sizes, axis=1) / 2
        self._spans = np.zeros((len(boxes), 2), np.int64)
        for index, box in enumerate(boxes):
            if box.frame is not None:
                self._spans[index] = box.frame
            else:
                self._spans[index] = self._span(index, box.window, numbers, positions)

    def _span(
        self,
        index: int,
        window: tuple[int, int] | None,
        numbers: Int64Array,
        positions: Float64Array,
    ) -> tuple[int, int]:
        """Return the first and last frame of the run around a window that a box is in reach of."""
        if window is None or not len(numbers):
            return 0, int(numbers[-1]) if len(numbers) else -1
        begin = int(np.searchsorted(numbers, window[0]))
        end = int(np.searchsorted(numbers, window[1], 'right'))
        middle, reach = self._middles[index], self._reaches[index]
        before = _count_near(positions[:begin][::-1], middle, reach)
        after = _count_near(positions[end:], middle, reach)
        first = min(window[0], int(numbers[begin - before])) if before else window[0]
        return first, max(window[1], int(numbers[end + after - 1])) if after else window[1]

    def frames(self, numbers: Int64Array) -> Int64Array:
        """Return those of (N,) frames, ascending, that boxes may be of."""
        change = np.zeros(len(numbers) + 1, np.int64)
        np.add.at(change, np.searchsorted(numbers, self._spans[:, 0]), 1)
        np.add.at(change, np.searchsorted(numbers, self._spans[:, 1], 'right'), -1)
        return numbers[np.cumsum(change[:-1]) > 0]

    def of_frame(self, number: int, velo_T_world: Transform, points: Float32Array) -> list[Cuboid]:
        """Return the boxes of a frame in velo_link, in the order of the file.

        Args:
            number: The frame.
            velo_T_world: The pose of the scanner, inverted.
            points: (N, 4) of the frame's scan, in velo_link.
        """
        there = (self._spans[:, 0] <= number) & (number <= self._spans[:, 1])
        indices = np.flatnonzero(there)
        distances = np.linalg.norm(velo_T_world.apply(self._middles[indices]), axis=1)
        near = [self._boxes[i] for i in indices[distances <= self._reaches[indices]].tolist()]
        cuboids = [
            Cuboid(
                box.class_name,
                str(box.track_id),
                velo_T_world @ box.world_T_box,
                box.size_lwh,
                track_id=box.track_id,
            )
            for box in near
        ]
        counts = count_points(cuboids, points)
        return [
            cuboid for cuboid, count in zip(cuboids, counts, strict=True) if count >= LEAST_POINTS
        ]

    def moving(self) -> dict[int, list[Cuboid]]:
        """Map frames to their moving objects, in the world."""
        frames: dict[int, list[Cuboid]] = {}
        for box in self._boxes:
            if box.frame is not None:
                place, track = box.world_T_box, box.track_id
                cuboid = Cuboid(box.class_name, str(track), place, box.size_lwh, track_id=track)
                frames.setdefault(box.frame, []).append(cuboid)
        return frames


def _count_near(positions: Float64Array, middle: Float64Array, reach: float) -> int:
    """Return how many of (N, 3) positions, from the first on, are within reach of a point."""
    for start in range(0, len(positions), _BLOCK):
        offsets = positions[start : start + _BLOCK] - middle
        beyond = np.flatnonzero(np.einsum('ij,ij->i', offsets, offsets) > reach**2)
        if len(beyond):
            return start + int(beyond[0])
    return len(positions)


def describe_shapes(shapes: Counter[str]) -> str:
    """Describe the objects that are no boxes, for a note; '' without any."""
    kinds = [f'{count} {label or "without a transform"}' for label, count in shapes.most_common()]
    return f'{shapes.total()} objects are no boxes ({", ".join(kinds)})' if kinds else ''
