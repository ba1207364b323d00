# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about a frame: its files together, its image, its scan, its tracklets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..files.image_files import decode_image
from ..kitti.scan_file import HEAD_BYTES, find_mismatch
from ..kitti.scan_grid import on_grid
from ..model.boxes import (
    alpha_of,
    box_corners,
    box_rotations,
    clip_bounds,
    has_cuboid,
    ious_2d,
    project_corners,
    wrap_angle,
)
from ..model.samples import rect_from_velo
from .rule import ERROR, NOTE, WARNING, Breach, RuleScope, RuleTable, breach_in

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from ..model.boxes import Box, Cuboid
    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Calibration, Float32Array, FrameLabels, Image
    from .file_rules import LabelLine


# Positions of 3D boxes in a scan, and boxes without points.

_SAMPLED = 16
_MARGIN_M = 0.05
"""Labels have two decimals, and annotators draw boxes close to the points."""


class BoxInScan(NamedTuple):
    """A box in velo_link.

    Attributes:
        middle: (3,) metres.
        rotation: (3, 3) velo_R_box.
        half: (3,) half length, width, height, with a margin.
        radius: Radius of the sphere around it.
        distance: Distance of its middle from the scanner.
    """

    middle: Float64Array
    rotation: Float64Array
    half: Float64Array
    radius: np.float32
    distance: float


def locate_labels(boxes: Sequence[Box], velo_t_rect: Sequence[Transform]) -> list[BoxInScan]:
    """Return the boxes of labels with positive sizes, by the transform of each frame."""
    location = np.array([box.location for box in boxes], np.float64).reshape(-1, 3)
    half = np.array([box.size_hwl[::-1] for box in boxes], np.float64).reshape(-1, 3) / 2
    location[:, 1] -= half[:, 2]
    velo_r_rect, offset = _stacked(velo_t_rect)
    middle = (velo_r_rect @ location[:, :, None])[:, :, 0] + offset
    return _in_scan(middle, velo_r_rect @ box_rotations([box.rotation_y for box in boxes]), half)


def locate_tracklets(cuboids: Sequence[Cuboid]) -> list[BoxInScan]:
    """Return the boxes of tracklets."""
    rotation, middle = _stacked([cuboid.velo_T_box for cuboid in cuboids])
    half = np.array([cuboid.size_lwh for cuboid in cuboids], np.float64).reshape(-1, 3) / 2
    return _in_scan(middle, rotation, half)


def _stacked(transforms: Sequence[Transform]) -> tuple[Float64Array, Float64Array]:
    """Return (N, 3, 3) rotations and (N, 3) translations."""
    rotations = np.array([transform.rotation for transform in transforms], np.float64)
    translations = np.array([transform.translation for transform in transforms], np.float64)
    return rotations.reshape(-1, 3, 3), translations.reshape(-1, 3)


def _in_scan(middle: Float64Array, rotation: Float64Array, half: Float64Array) -> list[BoxInScan]:
    radius = (np.linalg.norm(half, axis=1) + _MARGIN_M).astype(np.float32)
    distance = np.linalg.norm(middle, axis=1).tolist()
    return list(map(BoxInScan, middle, rotation, half + _MARGIN_M, radius, distance))


def boxes_without_points(points: Float32Array, located: Sequence[BoxInScan]) -> list[int]:
    """Return the indices of boxes without points; a sample of the points settles most.

    Args:
        points: (N, 4), a scan.
        located: Boxes in its frame.
    """
    indices = list(range(len(located)))
    for step in (_SAMPLED, 1):
        if indices:
            xyz = np.ascontiguousarray(points[::step, :3].T)
            indices = [index for index in indices if not _has_point(xyz, located[index])]
    return indices


def _has_point(xyz: Float32Array, box_in_scan: BoxInScan) -> bool:
    x, y, _ = box_in_scan.middle.astype(np.float32)
    near = (np.abs(xyz[0] - x) <= box_in_scan.radius).nonzero()[0]
    near = near[np.abs(xyz[1, near] - y) <= box_in_scan.radius]
    box_points = (xyz[:, near].T - box_in_scan.middle) @ box_in_scan.rotation
    return bool((np.abs(box_points) <= box_in_scan.half).all(axis=1).any())


# Rules about the files of a frame together: labels against calibration, image and scan.
#
# Limits, from tracking 0000 (711 boxes) and object 000000..2 (6 boxes): projected 3D boxes overlap
# their 2D boxes with an IoU of 0.52 at least, alpha is within 0.09 rad of rotation_y and the ray,
# 2D boxes are inside the image. KITTI's principal points are within 4 % of the image's middle.

Size = tuple[int, int]
_LEAST_IOU = 0.3
_ALPHA_RAD = 0.2
_BEYOND_PX = 2.0
_MIDDLE = 0.25  # of the image's size
_FARTHEST_LABEL_M = 1000.0  # labels beyond overflow, and have a rule
_LABELLED_CAMERA = 2
_NEAR_M = 40.0


@dataclass(frozen=True, eq=False)
class FrameFiles:
    """The parsed files of a frame without its scan.

    Attributes:
        number: File number.
        calibration: Calibration of the frame.
        sizes: (width, height) of its images by camera.
        calibration_path, label_path: The files.
        lines: The labels.
        cuboids: Boxes of tracklets, in velo_link.
    """

    number: int
    calibration: Calibration
    sizes: Mapping[int, tuple[int, int]]
    calibration_path: Path
    label_path: Path
    lines: Sequence[LabelLine] = ()
    cuboids: Sequence[Cuboid] = ()

    @cached_property
    def solid(self) -> list[LabelLine]:
        """The labels with a valid 3D box."""
        return [
            line
            for line in self.lines
            if has_cuboid(line.box)
            and min(line.box.size_hwl) > 0
            and max(map(abs, (*line.box.location, *line.box.size_hwl))) < _FARTHEST_LABEL_M
        ]

    @property
    def p_rect(self) -> Float64Array | None:
        """The projection of the camera of the labels."""
        camera = self.calibration.cameras.get(_LABELLED_CAMERA)
        is_usable = camera is not None and not self.calibration.is_independent(_LABELLED_CAMERA)
        return camera.p_rect if is_usable and camera is not None else None


class NearBox(NamedTuple):
    """A visible 3D box near the scanner.

    Attributes:
        name: Class; of a tracklet also its identity.
        line: Line of the label file, from 1; None for a tracklet.
        box_in_scan: The box in velo_link.
    """

    name: str
    line: int | None
    box_in_scan: BoxInScan


@dataclass(frozen=True, eq=False)
class LabelledScan:
    """A frame with the points of its scan, (N, 4), and the boxes near the scanner."""

    frame: FrameFiles
    points: Float32Array
    boxes: Sequence[NearBox]


def near_boxes(frames: Sequence[FrameFiles]) -> dict[int, list[NearBox]]:
    """Return the visible and near boxes by frame, computed for all at once."""
    calibrated = [
        (frame, velo_t_rect)
        for frame in frames
        if (velo_t_rect := _velo_from_rect(frame.calibration)) is not None
    ]
    labels = [
        (frame.number, label, velo_t_rect)
        for frame, velo_t_rect in calibrated
        for label in frame.solid
        if label.box.occluded <= 0
    ]
    cuboids = [(frame.number, cuboid) for frame, _ in calibrated for cuboid in frame.cuboids]
    named: list[tuple[int, str, int | None]] = [
        *((number, box.class_name, line) for number, (line, box), _ in labels),
        *((number, f'{cuboid.class_name} {cuboid.identity}', None) for number, cuboid in cuboids),
    ]
    located = [
        *locate_labels([label.box for _, label, _ in labels], [label for *_, label in labels]),
        *locate_tracklets([cuboid for _, cuboid in cuboids]),
    ]
    near: dict[int, list[NearBox]] = {}
    for (number, name, line), box_in_scan in zip(named, located, strict=True):
        if box_in_scan.distance < _NEAR_M:
            near.setdefault(number, []).append(NearBox(name, line, box_in_scan))
    return near


LABEL_FRAME_RULES = RuleTable[Sequence[FrameFiles]](RuleScope.FRAME)


@LABEL_FRAME_RULES.add(
    'label-projection',
    WARNING,
    '3D boxes, projected by P2, overlap their 2D boxes (IoU of 0.3 at least)',
    'check that calibration and labels are of this frame, and the order of the columns',
)
def _find_projection(frames: Sequence[FrameFiles]) -> Iterator[Breach]:
    groups: dict[tuple[int, Size], list[FrameFiles]] = {}
    for frame in frames:
        size = frame.sizes.get(_LABELLED_CAMERA)
        if frame.solid and frame.p_rect is not None and size is not None:
            groups.setdefault((id(frame.p_rect), size), []).append(frame)
    for (_, size), alike in groups.items():
        p_rect = alike[0].p_rect
        if p_rect is not None:
            yield from _find_apart(alike, p_rect, size)


def _find_apart(frames: Sequence[FrameFiles], p_rect: Float64Array, size: Size) -> Iterator[Breach]:
    """Find 3D boxes away from their 2D boxes, in frames of one projection."""
    solid = [(frame.label_path, label) for frame in frames for label in frame.solid]
    boxes = [label.box for _, label in solid]
    corners = box_corners(
        [box.location for box in boxes],
        [box.size_hwl for box in boxes],
        [box.rotation_y for box in boxes],
    )
    bounds, _ = clip_bounds(project_corners(corners, p_rect), size)
    overlaps = ious_2d(bounds, np.array([box.box_2d for box in boxes]).reshape(-1, 4)).tolist()
    for (path, (line, box)), overlap in zip(solid, overlaps, strict=True):
        left, top, right, bottom = box.box_2d
        if right > left and bottom > top and overlap < _LEAST_IOU:
            text = (
                f'{box.class_name}: the projected 3D box overlaps the 2D box by {overlap:.2f} (IoU)'
            )
            yield Breach(text, path, line)


@LABEL_FRAME_RULES.add(
    'label-alpha',
    WARNING,
    'alpha is rotation_y less the direction to the object, to 0.2 rad',
    'compute alpha = rotation_y - atan2(x, z)',
)
def _find_alpha(frames: Sequence[FrameFiles]) -> Iterator[Breach]:
    labels = [
        (frame.label_path, label)
        for frame in frames
        if not frame.calibration.is_independent(_LABELLED_CAMERA)
        for label in frame.solid
        if label.box.alpha != -10
    ]
    if not labels:
        return
    boxes = [label.box for _, label in labels]
    expected = alpha_of([box.location for box in boxes], [box.rotation_y for box in boxes])
    difference = wrap_angle(np.array([box.alpha for box in boxes]) - expected)
    for index in np.flatnonzero(np.abs(difference) > _ALPHA_RAD).tolist():
        path, (line, box) = labels[index]
        angle = f'{expected[index]:.2f}'
        text = f'{box.class_name}: alpha is {box.alpha:g}; location and rotation_y make {angle}'
        yield Breach(text, path, line)


FRAME_RULES = RuleTable[FrameFiles](RuleScope.FRAME)


@FRAME_RULES.add(
    'label-outside',
    WARNING,
    '2D boxes are inside the image of camera 2',
    'clip the box; check that the image was not resized or cropped',
)
def _find_outside(frame: FrameFiles) -> Iterator[Breach]:
    size = frame.sizes.get(_LABELLED_CAMERA)
    if size is None:
        return
    width, height = size
    for line, box in frame.lines:
        left, top, right, bottom = box.box_2d
        beyond = max(-left, -top, right - (width - 1), bottom - (height - 1))
        if beyond > _BEYOND_PX:
            numbers = ' '.join(f'{value:g}' for value in box.box_2d)
            text = f'{box.class_name}: the 2D box {numbers} leaves the image, {width}x{height}'
            yield Breach(text, frame.label_path, line)


@lru_cache(maxsize=64)
def _velo_from_rect(calibration: Calibration) -> Transform | None:
    """Return velo_T_rect; None without it."""
    try:
        return rect_from_velo(calibration).inverse()
    except ValueError:
        return None


SCAN_FRAME_RULES = RuleTable[LabelledScan](RuleScope.FRAME)


@SCAN_FRAME_RULES.add(
    'label-points',
    NOTE,
    'Points of the scan are inside each 3D box that is visible and within 40 m',
    'usual for some objects; if most are listed, check the calibration',
)
def _find_unscanned(scan: LabelledScan) -> Iterator[Breach]:
    for index in boxes_without_points(scan.points, [box.box_in_scan for box in scan.boxes]):
        name, line, box_in_scan = scan.boxes[index]
        text = f'frame {scan.frame.number}: {name} at {box_in_scan.distance:.0f} m'
        yield Breach(f'{text}: no point of the scan is inside', scan.frame.label_path, line)


@FRAME_RULES.add(
    'calib-image',
    WARNING,
    'Principal points are near the middle of the image',
    'give the calibration of these images; scale it if they were resized',
)
def _find_off_middle(frame: FrameFiles) -> Iterator[Breach]:
    for index, (width, height) in frame.sizes.items():
        camera = frame.calibration.cameras.get(index)
        if camera is None:
            continue
        x, y = float(camera.p_rect[0, 2]), float(camera.p_rect[1, 2])
        if abs(x / width - 0.5) > _MIDDLE or abs(y / height - 0.5) > _MIDDLE:
            text = f'P{index}: the principal point {x:.0f} {y:.0f} is far from the middle of images'
            yield Breach(f'{text} of {width}x{height}', frame.calibration_path)


"""Rules that see several frames at once: numpy takes as long for one as for ten."""


# Rules about the pixels of an image; only with --decode.


@dataclass(frozen=True, eq=False)
class ImageFile:
    """A parsed image.

    Attributes:
        path: The file.
        image: The image.
    """

    path: Path
    image: Image

    @cached_property
    def pixels(self) -> npt.NDArray[np.uint8 | np.uint16] | str:
        """The decoded pixels, or the reason why not."""
        try:
            return decode_image(self.image)
        except ValueError as error:
            return str(error)


IMAGE_RULES = RuleTable[ImageFile](RuleScope.FILE)


@IMAGE_RULES.add(
    'image-pixels',
    ERROR,
    'Pixels can be decoded (with --decode)',
    'copy or download the file again',
)
def _find_undecodable(file: ImageFile) -> Iterator[Breach]:
    if isinstance(file.pixels, str):
        yield Breach(f'the pixels cannot be decoded: {file.pixels}', file.path)


@IMAGE_RULES.add(
    'image-blank',
    WARNING,
    'Images are not of a single colour (with --decode)',
    'check the camera, or the program that wrote the image',
)
def _find_blank(file: ImageFile) -> Iterator[Breach]:
    if not isinstance(file.pixels, str) and file.pixels.min() == file.pixels.max():
        yield Breach(f'all pixels are {int(file.pixels.max())}', file.path)


# Rules about the values of a scan.
#
# Limits, from KITTI's scans (object 000000..2, raw 0052, odometry 00, semantickitti): coordinates
# are within 80 m, reflectances 0..0.99, no point is at the origin. Scanners of others reach 250 m.

_FARTHEST_POINT_M = 250.0
_NOT_METRES = 10_000.0
_STEP_LIMIT = 1e-6  # float32 of hundredths is within 3e-8
_COLUMNS = 4
_LOOKED_AT = HEAD_BYTES // 16
_FOLDED = 4096
"""Values reduced side by side: numpy reduces columns of four ten times slower."""


@dataclass(frozen=True, eq=False)
class ScanFile:
    """A parsed scan.

    Attributes:
        path: The file.
        points: (N, 4) float32, at least one.
        missing: Reason for missing labels of points.
        on_grid: Whether scans of its layout are on KITTI's grid (see LayoutTraits).
    """

    path: Path
    points: Float32Array
    missing: str = ''
    on_grid: bool = True

    @cached_property
    def bounds(self) -> tuple[list[float], list[float]]:
        """The least and greatest x, y, z and reflectance; NaN for a column with NaN."""
        flat = self.points.reshape(-1)
        return _reduce(np.minimum, flat), _reduce(np.maximum, flat)

    @cached_property
    def reach(self) -> float:
        """The greatest absolute coordinate, metres; NaN or infinite if any is."""
        low, high = self.bounds
        ends = [*low[:3], *high[:3]]
        return math.nan if any(map(math.isnan, ends)) else max(map(abs, ends))


def _reduce(ufunc: np.ufunc, flat: Float32Array) -> list[float]:
    """Return the least or greatest value of each column."""
    if len(flat) > _FOLDED:
        rows = flat[: len(flat) // _FOLDED * _FOLDED].reshape(-1, _FOLDED)
        flat = ufunc(ufunc.reduce(rows), flat[-_FOLDED:])  # some values are reduced twice
    columns: list[float] = ufunc.reduce(flat.reshape(-1, _COLUMNS).T.copy(), axis=1).tolist()
    return columns


SCAN_RULES = RuleTable[ScanFile](RuleScope.FILE)


@SCAN_RULES.add(
    'scan-finite',
    ERROR,
    'Coordinates and reflectances are finite numbers, below 10 km',
    'copy the file again; check that it has float32 x y z reflectance',
)
def _find_nonsense(scan: ScanFile) -> Iterator[Breach]:
    low, high = scan.bounds
    if not (scan.reach < _NOT_METRES and math.isfinite(low[3]) and math.isfinite(high[3])):
        nonsense = np.logical_not((np.abs(scan.points) < _NOT_METRES).all(axis=1))
        first = int(np.argmax(nonsense))
        values = ' '.join(f'{value:g}' for value in scan.points[first])
        text = f'{int(nonsense.sum())} of {len(nonsense)} points, the first is {first}: {values}'
        yield Breach(text, scan.path)


@SCAN_RULES.add(
    'scan-constant',
    ERROR,
    'Points of a scan are at different places',
    'copy the file again: an interrupted download leaves zeros',
)
def _find_constant(scan: ScanFile) -> Iterator[Breach]:
    low, high = scan.bounds
    if len(scan.points) > 1 and low[:3] == high[:3]:
        position = ' '.join(f'{value:g}' for value in low[:3])
        yield Breach(f'all {len(scan.points)} points are at {position}', scan.path)


@SCAN_RULES.add(
    'scan-range', WARNING, 'Points are within 250 m', 'check the unit (metres) and the four columns'
)
def _find_far(scan: ScanFile) -> Iterator[Breach]:
    if _FARTHEST_POINT_M < scan.reach < _NOT_METRES:
        yield Breach(f'coordinates up to {scan.reach:.0f} m', scan.path)


@SCAN_RULES.add(
    'scan-reflectance',
    WARNING,
    'Reflectances are 0 to 1',
    'divide intensities by their full scale, such as 255; check the columns of the scan',
)
def _find_reflectance(scan: ScanFile) -> Iterator[Breach]:
    low, high = (ends[3] for ends in scan.bounds)
    if low < 0 or 1 < high < _NOT_METRES:
        mismatch = find_mismatch([(scan.points[:_LOOKED_AT].tobytes(), scan.points.nbytes)])
        text = mismatch.problem if mismatch else f'reflectances from {low:g} to {high:g}'
        yield Breach(text, scan.path)


@SCAN_RULES.add(
    'scan-grid',
    WARNING,
    'Scans of KITTI-360 have 256ths of reflectance, not whole millimetres and hundredths',
    "check that it is a scan of KITTI-360: KITTI's other scans have those, and another rig",
)
def _find_on_grid(scan: ScanFile) -> Iterator[Breach]:
    points = scan.points[:_LOOKED_AT]
    if scan.on_grid or (on_grid(points[:, :3]) != points[:, :3]).any():
        return
    reflectances = points[:, 3].astype(np.float64)
    steps = {
        count: np.abs(np.rint(reflectances * count) / count - reflectances).max()
        for count in (100, 256)
    }
    if steps[100] < _STEP_LIMIT <= steps[256]:
        yield Breach('whole millimetres, and hundredths of reflectance', scan.path)


@SCAN_RULES.add(
    'scan-labels',
    ERROR,
    'Labels of points (SemanticKITTI) exist for each scan, one for each point',
    'copy the .label file again; labels and scans must be of one sequence',
)
def _find_point_labels(scan: ScanFile) -> Iterator[Breach]:
    if scan.missing:
        yield breach_in(scan.missing.partition('; its points')[0], scan.path.parent.parent)


# Rules about the tracklets of a raw drive.


@dataclass(frozen=True, eq=False)
class TrackletFrame:
    """The tracklets of a frame, and their file."""

    path: Path
    labels: FrameLabels


TRACKLET_RULES = RuleTable[TrackletFrame](RuleScope.FRAME)


@TRACKLET_RULES.add(
    'tracklet-size',
    ERROR,
    'Tracklets have positive heights, widths and lengths',
    'correct the item of tracklet_labels.xml',
)
def _find_sizes(frame: TrackletFrame) -> Iterator[Breach]:
    for reason in frame.labels.missing.values():
        yield breach_in(reason.partition('; it gets no')[0], frame.path)
