# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Boxes in messages: vision_msgs, Autoware's objects, cubes of markers; to and from labels."""

from __future__ import annotations

import re
import struct
from bisect import bisect_left
from collections import Counter
from itertools import islice, takewhile
from math import cos, isfinite, nan, sin
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import UUID

import numpy as np

from ..model.bag_formats import LABEL_INFO
from ..model.boxes import Cuboid
from ..model.classes import class_of, label_of
from ..model.geometry import Transform
from .cdr import CdrWriter, make_header, pose_numbers
from .ros_types import TYPESTORE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from ..model.boxes import Box
    from .cdr import Parts


# Labels -> vision_msgs/Detection3DArray and Detection2DArray; any of these -> boxes.
#
# A detection's id is the track id, or the box's index in its file; the same box has the same id in
# both arrays. Ground truth has score 1, predictions their own. Covariances are zero, unknown.

ABSURD = 'without a possible size, place or score'
UNPLACED = 'in a frame that nothing joins to the scans'

_TRUTH_SCORE = 1.0
_UNKNOWN = (0.0,) * 36
_NO_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NO_TURN = 0.0
_TRUTH_SCORES = frozenset({0.0, 1.0})
_FARTHEST_M = 1e5  # from the scanner; no sensor sees it, and no box is so large


class ImageBox(NamedTuple):
    """A 2D detection.

    Attributes:
        class_name, identity: As in Cuboid.
        box_2d: left, top, right, bottom, pixels.
        score: Detection score, None without a result.
        frame: Its frame, without a leading slash: the camera whose pixels they are.
    """

    class_name: str
    identity: str
    box_2d: tuple[float, float, float, float]
    score: float | None
    frame: str


def encode_detections(cuboids: Sequence[Cuboid], stamp_ns: int, frame_id: str) -> Parts:
    """Make a Detection3DArray of cuboids, serialised; its frame is velo_link."""
    cdr = CdrWriter()
    cdr.header(stamp_ns, frame_id)
    cdr.uint32(len(cuboids))
    for cuboid in cuboids:
        pose = pose_numbers(cuboid.velo_T_box)
        cdr.header(stamp_ns, frame_id)
        _add_result(cdr, cuboid.class_name, cuboid.score, pose)
        cdr.float64((*pose, *cuboid.size_lwh))
        cdr.text(cuboid.identity)
    return (cdr.finish(),)


def encode_boxes_2d(boxes: Sequence[tuple[str, Box]], stamp_ns: int, frame_id: str) -> Parts:
    """Make a Detection2DArray of the 2D boxes of labels, DontCare included, serialised.

    Args:
        boxes: Each with its id.
        stamp_ns: Nanoseconds.
        frame_id: The optical frame of the camera whose pixels they are.
    """
    cdr = CdrWriter()
    cdr.header(stamp_ns, frame_id)
    cdr.uint32(len(boxes))
    for identity, box in boxes:
        left, top, right, bottom = box.box_2d
        cdr.header(stamp_ns, frame_id)
        _add_result(cdr, box.class_name, box.score, _NO_POSE)
        middle = ((left + right) / 2, (top + bottom) / 2)
        cdr.float64((*middle, _NO_TURN, right - left, bottom - top))
        cdr.text(identity)
    return (cdr.finish(),)


def encode_label_info(labels: Mapping[int, str], stamp_ns: int) -> object:
    """Make the LabelInfo of classes by id."""
    vision_class = TYPESTORE.types['vision_msgs/msg/VisionClass']
    classes = [vision_class(number, label) for number, label in sorted(labels.items())]
    return TYPESTORE.types[LABEL_INFO](make_header(stamp_ns, ''), classes, 0.0)


def _add_result(
    cdr: CdrWriter, class_name: str, score: float | None, pose: tuple[float, ...]
) -> None:
    """Write the results of a detection: one ObjectHypothesisWithPose."""
    cdr.uint32(1)
    cdr.text(class_name)
    cdr.float64((_TRUTH_SCORE if score is None else score, *pose, *_UNKNOWN))


def has_scores(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    """Return whether boxes are predictions: scores that are all 0 or 1 are of ground truth."""
    scores = [obj.existence_probability for obj in getattr(message, 'objects', ())]
    for detection in getattr(message, 'detections', ()):
        scores += map(_score, detection.results)
    return any(score not in _TRUTH_SCORES for score in scores)


def cuboids_of_detections(
    message: Any,  # noqa: ANN401 - of the bag's types
    to_velo: Mapping[str, Transform],
    *,
    scores: bool = False,
) -> tuple[list[Cuboid], list[str]]:
    """Decode a vision_msgs/Detection3DArray to boxes in velo_link; also why others were skipped.

    The result with the best score is used. The definitions of ROS 1 and of Foxy are supported: a
    result without hypothesis, its id the class, no id or a tracking_id of the detection.

    Args:
        message: A message of the bag's own types.
        to_velo: velo_T_frame by frame name.
        scores: Whether the recording has scores, even if these look like ground truth.

    Raises:
        ValueError: All boxes are in frames that are not joined.
    """
    scores = scores or has_scores(message)

    def make(detection: Any) -> Cuboid:  # noqa: ANN401 - as above
        class_name, identity, score = _best_result(detection)
        frame = detection.header.frame_id or message.header.frame_id
        size = detection.bbox.size
        return Cuboid(
            class_name,
            identity,
            pose_in_velo(detection.bbox.center, frame, to_velo),
            (size.x, size.y, size.z),
            score if scores else None,
        )

    return make_cuboids(message.detections, make)


def boxes_of_detections_2d(message: Any) -> tuple[list[ImageBox], list[str]]:  # noqa: ANN401
    """Decode a vision_msgs/Detection2DArray; also why others were skipped.

    A rotated box becomes the upright one around it. Definitions of ROS 1 and of Foxy are supported.
    """
    boxes = []
    for detection in message.detections:
        center = detection.bbox.center
        middle = getattr(center, 'position', center)
        theta = center.theta if isfinite(center.theta) else nan
        c, s = abs(cos(theta)), abs(sin(theta))
        size = detection.bbox.size_x, detection.bbox.size_y
        across, down = (c * size[0] + s * size[1]) / 2, (s * size[0] + c * size[1]) / 2
        bounds = middle.x - across, middle.y - down, middle.x + across, middle.y + down
        class_name, identity, score = _best_result(detection)
        frame = (detection.header.frame_id or message.header.frame_id).lstrip('/')
        if min(size) > 0 and all(map(isfinite, bounds)) and isfinite(score or 0.0):
            boxes.append(ImageBox(class_name, identity, bounds, score, frame))
    return boxes, [ABSURD] * (len(message.detections) - len(boxes))


def frames_of_detections(message: Any) -> set[str]:  # noqa: ANN401 - of the bag's types
    """Return the frames of the detections of an array, without leading slashes."""
    return {
        (detection.header.frame_id or message.header.frame_id).lstrip('/')
        for detection in message.detections
    }


def _best_result(detection: Any) -> tuple[str, str, float | None]:  # noqa: ANN401 - as above
    """Return the class, empty without a result, the id and the score of a detection."""
    best = max(detection.results, key=_score, default=None)
    identity = getattr(detection, 'id', '') or getattr(detection, 'tracking_id', '')
    return (
        '' if best is None else _class(best),
        identity,
        None if best is None else _score(best),
    )


def pose_in_velo(
    pose: Any,  # noqa: ANN401 - of the bag's types
    frame: str,
    to_velo: Mapping[str, Transform],
) -> Transform:
    """Convert a Pose in a frame to velo_link; an orientation of zeros is no rotation, as in RViz.

    A pose that is not finite becomes NaN.

    Raises:
        ValueError: The frame is not joined.
    """
    name = frame.lstrip('/')
    if name not in to_velo:
        raise ValueError(f'a box in frame {name!r}, which no static transform joins to the scans')
    p, q = pose.position, pose.orientation
    position, xyzw = np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w])
    if not np.isfinite([*position, *xyzw]).all():
        frame_T_box = Transform(np.full((3, 3), np.nan), np.full(3, np.nan))
    elif xyzw.any():
        frame_T_box = Transform.from_quaternion(xyzw, position)
    else:
        frame_T_box = Transform.from_translation(position)
    return to_velo[name] @ frame_T_box


def make_cuboids(
    boxes: Iterable[Any],
    make: Callable[[Any], Cuboid],
) -> tuple[list[Cuboid], list[str]]:
    """Make the boxes of a message; also return why others were skipped: ABSURD or UNPLACED.

    Args:
        boxes: Boxes of the bag's types.
        make: Raises ValueError for a box in a frame that is not joined.

    Raises:
        ValueError: They all are.
    """
    cuboids, faults = [], []
    for box in boxes:
        try:
            cuboids.append(make(box))
        except ValueError as error:
            faults.append(error)
    if faults and not cuboids:
        raise faults[0]
    plausible, left_out = possible(cuboids)
    return plausible, left_out + [UNPLACED] * len(faults)


def possible(cuboids: list[Cuboid]) -> tuple[list[Cuboid], list[str]]:
    """Return the boxes with a possible size, pose and score, and ABSURD for each of the others."""
    plausible = [
        cuboid
        for cuboid in cuboids
        if (np.abs([*cuboid.velo_T_box.matrix().ravel(), *cuboid.size_lwh]) < _FARTHEST_M).all()
        and min(cuboid.size_lwh) > 0
        and (cuboid.score is None or np.isfinite(cuboid.score))
    ]
    return plausible, [ABSURD] * (len(cuboids) - len(plausible))


def _score(result: Any) -> float:  # noqa: ANN401 - of the bag's types
    score = getattr(getattr(result, 'hypothesis', result), 'score', 1.0)
    return float(score) if isinstance(score, (int, float)) else 1.0


def _class(result: Any) -> str:  # noqa: ANN401 - of the bag's types
    hypothesis = getattr(result, 'hypothesis', result)
    return str(getattr(hypothesis, 'class_id', getattr(hypothesis, 'id', '')))


# Labels -> autoware_perception_msgs/DetectedObjects and TrackedObjects; any of these -> boxes.
#
# As Autoware's own detectors fill them (autoware_universe, perception/autoware_lidar_centerpoint,
# lib/ros_utils.cpp, lines 26 to 80 of commit 02ee90f): the pose is the middle of the box,
# dimensions are length, width and height along its x, y and z, the score is existence_probability,
# and the one classification has probability 1. KITTI's headings are known with their sign. Its
# labels have no covariance, velocity or acceleration: these are zero, and marked as unknown where
# there is a field for it. An object_id is a UUID of version 8 (RFC 9562) that ends with the track
# id.

_BOUNDING_BOX, _CYLINDER, _POLYGON = range(3)
_ORIENTATION_AVAILABLE = 2
_TRUE = 1.0
_COVARIANCE = (0.0,) * 36
_MOTION = (0.0,) * 42
"""A TwistWithCovariance or AccelWithCovariance."""

_TRACK = struct.Struct('>12sI')
_TRACK_PREFIX = bytes.fromhex('6b6974746900 8000 80000000')
"""The UUIDs 6b697474-6900-8000-8000-0000TTTTTTTT: "kitti", version, variant, track id."""


class ObjectFrame(NamedTuple):
    """The frame that objects are given in.

    Attributes:
        name: Its frame_id.
        frame_T_velo: velo_link in it.
        labels: Names of Autoware's labels by class; see autoware_labels.label_of.
    """

    name: str
    frame_T_velo: Transform
    labels: Mapping[str, str]


def encode_detected_objects(cuboids: Sequence[Cuboid], stamp_ns: int, frame: ObjectFrame) -> Parts:
    """Make a DetectedObjects of cuboids, serialised."""
    cdr = _begin(len(cuboids), stamp_ns, frame)
    for cuboid in cuboids:
        _add_class_and_pose(cdr, cuboid, frame)
        cdr.boolean(value=False)  # has_position_covariance
        cdr.byte(_ORIENTATION_AVAILABLE)
        cdr.float64(_MOTION)
        cdr.boolean(value=False)  # has_twist
        cdr.boolean(value=False)  # has_twist_covariance
        _add_shape(cdr, cuboid)
    return (cdr.finish(),)


def encode_tracked_objects(cuboids: Sequence[Cuboid], stamp_ns: int, frame: ObjectFrame) -> Parts:
    """Make a TrackedObjects of the cuboids with a track, serialised.

    Raises:
        struct.error: A track id has more than 32 bits.
    """
    tracked = [(box, box.track_id) for box in cuboids if _has_track(box)]
    cdr = _begin(len(tracked), stamp_ns, frame)
    for cuboid, track_id in tracked:
        cdr.octets(_TRACK.pack(_TRACK_PREFIX, track_id))
        _add_class_and_pose(cdr, cuboid, frame)
        cdr.float64(_MOTION)
        cdr.float64(_MOTION)
        cdr.byte(_ORIENTATION_AVAILABLE)
        cdr.boolean(value=False)  # is_stationary
        _add_shape(cdr, cuboid)
    return (cdr.finish(),)


def _has_track(cuboid: Cuboid) -> bool:
    return cuboid.track_id is not None and cuboid.track_id >= 0


def _begin(count: int, stamp_ns: int, frame: ObjectFrame) -> CdrWriter:
    cdr = CdrWriter()
    cdr.header(stamp_ns, frame.name)
    cdr.uint32(count)
    return cdr


def _add_class_and_pose(cdr: CdrWriter, cuboid: Cuboid, frame: ObjectFrame) -> None:
    """Write existence_probability, classification and the pose of the kinematics."""
    cdr.float32(_TRUE if cuboid.score is None else cuboid.score)
    cdr.uint32(1)
    cdr.byte(label_of(cuboid.class_name, frame.labels))
    cdr.float32(_TRUE)
    cdr.float64((*pose_numbers(frame.frame_T_velo @ cuboid.velo_T_box), *_COVARIANCE))


def _add_shape(cdr: CdrWriter, cuboid: Cuboid) -> None:
    cdr.byte(_BOUNDING_BOX)
    cdr.uint32(0)  # footprint
    cdr.float64(cuboid.size_lwh)


def cuboids_of_objects(
    message: Any,  # noqa: ANN401 - of the bag's types
    to_velo: Mapping[str, Transform],
    *,
    scores: bool = False,
) -> tuple[list[Cuboid], list[str]]:
    """Decode DetectedObjects or TrackedObjects to boxes in velo_link; also why others were skipped.

    The most probable class is used. A cylinder or a polygon becomes the box around it.

    Args:
        message: A message of the bag's own types.
        to_velo: velo_T_frame by frame name.
        scores: Whether existence probabilities are scores.

    Raises:
        ValueError: The message is in a frame that is not joined.
    """
    cuboids = []
    for detection in message.objects:
        pose = detection.kinematics.pose_with_covariance.pose
        offset, size = _bounds(detection.shape)
        best = max(detection.classification, key=lambda label: label.probability, default=None)
        cuboids.append(
            Cuboid(
                '' if best is None else class_of(int(best.label)),
                _identity(detection),
                pose_in_velo(pose, message.header.frame_id, to_velo) @ offset,
                size,
                float(detection.existence_probability) if scores else None,
            )
        )
    return possible(cuboids)


def _bounds(shape: Any) -> tuple[Transform, tuple[float, float, float]]:  # noqa: ANN401 - as above
    """Return the pose of the box around a shape in the object's frame, and its size.

    The x of a cylinder is its diameter, and the footprint of a polygon is in the object's frame
    (autoware_universe, common/autoware_universe_utils/src/geometry/boost_polygon_utils.cpp,
    toPolygon2d, commit abee5b5).
    """
    size = shape.dimensions
    points = [(point.x, point.y) for point in shape.footprint.points]
    if shape.type == _CYLINDER:
        return Transform.identity(), (size.x, size.x, size.z)
    if shape.type != _POLYGON or not points:
        return Transform.identity(), (size.x, size.y, size.z)
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    middle_x, middle_y = ((low + high) / 2).tolist()
    length, width = (high - low).tolist()
    return Transform.from_translation((middle_x, middle_y, 0.0)), (length, width, size.z)


def _identity(detection: Any) -> str:  # noqa: ANN401 - as above
    """Return the track id of our own UUIDs, others as text; empty without one, or for zeros."""
    if not hasattr(detection, 'object_id'):
        return ''
    data = bytes(detection.object_id.uuid)
    prefix, track_id = _TRACK.unpack(data)
    if prefix == _TRACK_PREFIX:
        return str(track_id)
    return str(UUID(bytes=data)) if any(data) else ''


# The cubes of any visualization_msgs/MarkerArray -> boxes in velo_link.
#
# Markers are drawn for people: the class of a box is in a caption, in a namespace, or missing.

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
        message: A message of the bag's own types.
        to_velo: velo_T_frame by frame name.
        scores: Whether to read scores from the captions: car 0.87, or car 87%.

    Raises:
        ValueError: All boxes are in frames that are not joined.
    """
    shown = _shown(message)
    captions = _Captions(shown)
    cubes = [marker for marker in shown if marker.type == _CUBE]
    framed = {cube.id for cube in cubes}
    lists = [
        line for line in shown if line.type in {_LINE_LIST, _CUBE_LIST} and line.id not in framed
    ]

    def make(cube: Any) -> Cuboid:  # noqa: ANN401 - as above
        return Cuboid(
            _class_of(cube, captions),
            f'{cube.ns}/{cube.id}',
            pose_in_velo(cube.pose, cube.header.frame_id, to_velo),
            (cube.scale.x, cube.scale.y, cube.scale.z),
            _score_of(cube, captions) if scores else None,
        )

    cuboids, left_out = make_cuboids(cubes, make)
    return cuboids, left_out + [AS_LINES] * len(lists)


def frames_of_markers(message: Any) -> set[str]:  # noqa: ANN401 - of the bag's types
    """Return the frames of the cubes that cuboids_of_markers decodes, without leading slashes."""
    return {cube.header.frame_id.lstrip('/') for cube in _shown(message) if cube.type == _CUBE}


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
        self._cubes = Counter(marker.id for marker in shown if marker.type == _CUBE)
        self._texts: dict[int, list[tuple[str, int, str]]] = {}
        for index, marker in enumerate(shown):
            if marker.type == _TEXT:
                self._texts.setdefault(marker.id, []).append((marker.ns, index, marker.text))
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
        return list(takewhile(lambda caption: caption[0].startswith(namespace), following))


def _class_of(cube: Any, captions: _Captions) -> str:  # noqa: ANN401 - of the bag's types
    """Return the class of a cube, empty if unknown.

    It is in a caption, or it is the cube's namespace.
    """
    candidates = [*captions.of(cube), cube.ns.rpartition('/')[2]]
    return next((class_name for text in candidates if (class_name := _class_in(text))), '')


def _score_of(cube: Any, captions: _Captions) -> float | None:  # noqa: ANN401 - of the bag's types
    """Return the last fraction or percentage in the captions of a cube, None without one."""
    matches = [match for text in captions.of(cube) for match in _SCORE.finditer(text)]
    if not matches:
        return None
    number = float(matches[-1][1])
    return number / 100 if matches[-1][2] else number


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


# 3D boxes of any message type that has them -> boxes in velo_link.


def cuboids_in(
    message: Any,  # noqa: ANN401 - of the bag's types
    to_velo: Mapping[str, Transform],
    *,
    scores: bool,
) -> tuple[list[Cuboid], list[str]]:
    """Decode a Detection3DArray, DetectedObjects, TrackedObjects or MarkerArray.

    Args:
        message: A message of the bag's own types.
        to_velo: velo_T_frame by frame name.
        scores: Whether the boxes have scores.

    Returns:
        The boxes in velo_link, and the reasons why others were skipped.

    Raises:
        ValueError: All boxes are in frames that are not joined.
    """
    if hasattr(message, 'detections'):
        return cuboids_of_detections(message, to_velo, scores=scores)
    if hasattr(message, 'objects'):
        return cuboids_of_objects(message, to_velo, scores=scores)
    return cuboids_of_markers(message, to_velo, scores=scores)


def boxes_in(message: Any) -> list[Cuboid]:  # noqa: ANN401 - as above
    """Return the boxes that cuboids_in decodes, each in its own frame.

    Raises:
        ValueError: They cannot be read.
    """
    here = dict.fromkeys(frames_in(message), Transform.identity())
    return cuboids_in(message, here, scores=False)[0]


def box_count(message: Any) -> int:  # noqa: ANN401 - as above
    """Return the number of detections or objects of a message."""
    return len(message.detections if hasattr(message, 'detections') else message.objects)


def frames_in(message: Any) -> set[str]:  # noqa: ANN401 - as above
    """Return the frames of the boxes that cuboids_in decodes, without leading slashes."""
    if hasattr(message, 'detections'):
        return frames_of_detections(message)
    if hasattr(message, 'objects'):
        return {message.header.frame_id.lstrip('/')} if message.objects else set()
    return frames_of_markers(message)
