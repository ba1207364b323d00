# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Samples of a recording, frozen: scans, images, packets, poses, calibration, labels."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from .boxes import cuboid_of, has_cuboid, is_absurd
from .geometry import Transform, rotation_from_rpy
from .streams import Stream

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from .boxes import Box, Cuboid
    from .errors import Loss
    from .geometry import Float64Array
    from .lenses import Lens
    from .streams import Layout


Float32Array: TypeAlias = npt.NDArray[np.float32]
Int64Array: TypeAlias = npt.NDArray[np.int64]

PNG, JPEG = 'png', 'jpeg'
"""The formats of images, as CompressedImage names them."""
MOST_PIXELS = 2**26
"""The limit of an image, above the size of any camera on a vehicle, within memory."""


@dataclass(frozen=True)
class TextFile:
    """A text file, verbatim, so that it can be restored byte for byte.

    Attributes:
        name: Path relative to the recording's root, with forward slashes.
        text: The whole content, line ends unchanged.
    """

    name: str
    text: str


@dataclass(frozen=True)
class Turn:
    """One turn of the scanner: clockwise seen from above, from straight behind to straight behind.

    Attributes:
        start_ns: When it faces straight behind; it faces forward half a turn later.
        length_ns: Nanoseconds.
        nominal: Whether the length is assumed because start and end stamps are missing.
    """

    start_ns: int
    length_ns: int
    nominal: bool = False

    @property
    def forward_ns(self) -> int:
        """The stamp at which the scanner faces forward."""
        return self.start_ns + self.length_ns // 2

    @property
    def end_ns(self) -> int:
        """The stamp at which it faces straight behind again."""
        return self.start_ns + self.length_ns


@dataclass(frozen=True, eq=False)
class Scan:
    """One sweep of the laser scanner.

    Attributes:
        points: (N, 4) float32: x y z in metres in velo_link (x forward, y left, z up), and
            reflectance 0..1.
        start_ns, end_ns: First and last firing of the sweep, None if unknown.
        labels: (N,) uint32 of SemanticKITTI, low 16 bits class, high 16 instance, on request.
        missing: Requested data that is missing: name to the reason, a line.
        turn: When each direction was scanned; None if all points are of one time, as in scans
            that KITTI has compensated for motion.
        difference: Difference of the points from those of the file, '' if they are the same.
        extra: Further columns of the file by name, (N,) float32 or float64; see ScanColumns.
        note: How its points differ from what was asked for, '' for not at all.
    """

    points: Float32Array
    start_ns: int | None = None
    end_ns: int | None = None
    labels: npt.NDArray[np.uint32] | None = None
    missing: Mapping[str, str] = field(default_factory=dict)
    turn: Turn | None = None
    difference: str = ''
    extra: Mapping[str, npt.NDArray[np.floating]] = field(default_factory=dict)
    note: str = ''


@dataclass(frozen=True, eq=False)
class LineScan:
    """One scan of KITTI-360's SICK, which measures in a plane.

    Attributes:
        points: (N, 3) float32, x y z in metres in sick_link; x is 0.
    """

    points: Float32Array


# Scans as whole multiples of 1 mm and 0.01; see kitti/compact_scan.py.

MISSING = -(2**31)
"""The multiple of NaN."""


class Exceptions(NamedTuple):
    """Values of a scan's file that do not follow from its multiples.

    Attributes:
        indices: (M,) in the file, ascending.
        bits: (M,) of the values.
    """

    indices: npt.NDArray[np.uint32]
    bits: npt.NDArray[np.uint32]


class GridSteps(NamedTuple):
    """Coordinates that were measured some steps of the grid beside what rounded points give.

    Attributes:
        indices: (M,) in the (N, 3) coordinates, ascending.
        steps: (M,) millimetres.
    """

    indices: npt.NDArray[np.uint32]
    steps: npt.NDArray[np.int8]


class ScanRest(NamedTuple):
    """What makes the file of a scan again of its rounded points.

    Attributes:
        crc: CRC-32 of the file.
        exceptions: None of a scan that is no grid, whose points are not rounded.
        twist: (6,) of a turn, see kitti/scan_grid.py; None for a measured scan, as steps.
        steps: What rounding to a millimetre took to another point of the grid.
    """

    crc: int
    exceptions: Exceptions | None = None
    twist: Float64Array | None = None
    steps: GridSteps | None = None


class CompactScan(NamedTuple):
    """A scan as multiples, and the rest of its file.

    Attributes:
        multiples: (N, 4) int32, of which NaN is MISSING; None of a scan that is no grid.
        rest: The rest of the file.
    """

    multiples: npt.NDArray[np.int32] | None
    rest: ScanRest


@dataclass(frozen=True)
class Image:
    """One encoded camera image.

    Attributes:
        data: The file's own bytes.
        width, height: Pixels.
        channels: 1 (grey) or 3 (colour).
        format: png or jpeg, as CompressedImage names it.
    """

    data: bytes = field(repr=False)
    width: int
    height: int
    channels: int
    format: str = PNG


@dataclass(frozen=True)
class OxtsPacket:
    """One packet of the GPS/IMU: the 30 columns of KITTI's dataformat.txt, in its order.

    Positions in degrees and metres, angles in radians, velocities in m/s, accelerations in m/s^2
    (gravity included), rates in rad/s. x, y, z are the IMU's own body axes (forward, left, up);
    f, l, u are levelled: forward and left parallel to the earth's surface, up perpendicular to it.
    source is the line it was read from, verbatim, under its file's name.
    """

    lat: float
    lon: float
    alt: float
    roll: float
    pitch: float
    yaw: float
    vn: float
    ve: float
    vf: float
    vl: float
    vu: float
    ax: float
    ay: float
    az: float
    af: float
    al: float
    au: float
    wx: float
    wy: float
    wz: float
    wf: float
    wl: float
    wu: float
    pos_accuracy: float
    vel_accuracy: float
    navstat: int
    numsats: int
    posmode: int
    velmode: int
    orimode: int
    source: TextFile | None = field(default=None, compare=False, repr=False)

    def body_velocity(self) -> Float64Array:
        """Return (3,) m/s in body axes (forward, left, up), from ve vn vu and the attitude.

        Not from vf vl vu: the data set's vl is positive to the right, unlike its dataformat.txt
        (drive 0001: -ve sin(yaw) + vn cos(yaw) is -vl to 1 cm/s).
        """
        east_north_up = np.array([self.ve, self.vn, self.vu])
        body: Float64Array = rotation_from_rpy(self.roll, self.pitch, self.yaw).T @ east_north_up
        return body


@dataclass(frozen=True, eq=False)
class Pose:
    """The pose of the vehicle: imu_link in a fixed frame, and its motion if known.

    Attributes:
        world_T_imu: Pose of imu_link in the frame that is fixed to the world: a reader's own (see
            Start), or map.
        velocity: (3,) m/s in imu_link axes, or None.
        angular_velocity: (3,) rad/s in imu_link axes, or None.
        position_sigma, velocity_sigma: One standard deviation in metres and m/s, or None.
    """

    world_T_imu: Transform
    velocity: Float64Array | None = None
    angular_velocity: Float64Array | None = None
    position_sigma: float | None = None
    velocity_sigma: float | None = None


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of imu_link in a fixed frame, as in Pose: stamps and transforms of one length."""

    stamps_ns: Int64Array
    world_T_imu: Sequence[Transform]


@dataclass(frozen=True)
class Description:
    """The recording as a whole.

    Attributes:
        values: Plain JSON values, needed to restore the files of the recording from a bag.
        files: Text files of the whole recording, verbatim.
        missing: Unreadable ones: name to the reason, a line.
    """

    values: Mapping[str, object]
    files: Sequence[TextFile] = ()
    missing: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """One camera of a rig.

    Attributes:
        p_rect: (3, 4), projects points of the rectified camera 0 to this camera's rectified pixels;
            with cam_T_velo, points of this camera's own frame.
        size: (width, height) of its rectified images, None if the calibration does not contain it.
        k, d: (3, 3) and (5,) of the unrectified camera (plumb bob), raw layout only.
        r_rect: (3, 3), its rectifying rotation, raw layout only.
        cam_T_cam0: Unrectified camera 0 to this unrectified camera, raw layout only.
        cam_T_velo: This camera's own extrinsics (Waymo in KITTI's shape), None on a KITTI rig.
        lens: The lens of a camera with extrinsics of its own (KITTI-360's fisheyes); p_rect has K.
    """

    p_rect: Float64Array
    size: tuple[int, int] | None = None
    k: Float64Array | None = None
    d: Float64Array | None = None
    r_rect: Float64Array | None = None
    cam_T_cam0: Transform | None = None
    cam_T_velo: Transform | None = None
    lens: Lens | None = None


@dataclass(frozen=True, eq=False)
class Calibration:
    """The rig at one time.

    Attributes:
        cameras: By KITTI camera index; a camera without valid numbers is absent.
        r0_rect: (3, 3), unrectified to rectified camera 0 (KITTI's R0_rect, R_rect_00).
        cam0_T_velo: velo_link to unrectified camera 0 (KITTI's Tr_velo_to_cam).
        velo_T_imu: imu_link to velo_link (KITTI's Tr_imu_to_velo).
        rectified: Whether the images are rectified (False for raw extract).
        nominal: Attributes that are documented defaults because the files do not contain them.
        missing: Missing parts (P2, Tr_velo_to_cam): part to the reason, a line.
        files: Its files, verbatim.
        notes: Remarks on the files that cost no data, a line each.
        velo_T_sick: sick_link to velo_link; None on a rig without this scanner.
        mounts: cam_T_velo of cameras that have no other valid numbers.
        nominal_mounts: The same where the files have none, unlike KITTI's.
    """

    cameras: Mapping[int, CameraCalibration]
    r0_rect: Float64Array | None
    cam0_T_velo: Transform | None
    velo_T_imu: Transform
    rectified: bool = True
    nominal: tuple[str, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)
    files: tuple[TextFile, ...] = ()
    notes: tuple[str, ...] = ()
    velo_T_sick: Transform | None = None
    mounts: Mapping[int, Transform] = field(default_factory=dict)
    nominal_mounts: Mapping[int, Transform] = field(default_factory=dict)

    @property
    def independent_cameras(self) -> bool:
        """True if cameras have extrinsics of their own instead of a common rectified frame."""
        return any(camera.cam_T_velo is not None for camera in self.cameras.values())

    def is_independent(self, index: int) -> bool:
        """Return whether a camera has extrinsics of its own, or lost those that others have.

        Without them a camera is one of the rectified rig, if camera 0 is (KITTI-360).
        """
        own = {number for number, camera in self.cameras.items() if camera.cam_T_velo is not None}
        return index in own or (bool(own) and (0 in own or self.cam0_T_velo is None))


Sample: TypeAlias = (
    'Description | Scan | LineScan | Image | OxtsPacket | Pose | Trajectory | FrameLabels'
    ' | Calibration'
)


@dataclass(frozen=True, eq=False)
class FrameLabels:
    """The labelled objects of one frame.

    Attributes:
        boxes: Boxes of a label file, in the file's order; None for an invalid line.
        cuboids: Boxes of tracklets, in velo_link; a frame has these or boxes.
        source: The frame's lines verbatim, under their file's name; None for tracklets.
        missing: Invalid lines: index to the reason, a line.
    """

    boxes: Sequence[Box | None] = ()
    cuboids: Sequence[Cuboid] = ()
    source: TextFile | None = None
    missing: Mapping[str, str] = field(default_factory=dict)


# The positions of KITTI's rectified cameras relative to each other.

LEFT_OF = {1: 0, 3: 2}
"""The left camera of each right camera's stereo pair."""


def rectified_offset(camera: CameraCalibration) -> Float64Array:
    """Return (3,) metres t = K^-1 P[:, 3]: p of the rectified camera 0 is p + t in this camera."""
    return np.asarray(np.linalg.solve(camera.p_rect[:, :3], camera.p_rect[:, 3]), np.float64)


# The labels of a frame as boxes in velo_link, and the trails of tracks over frames.


def rect_from_velo(calibration: Calibration) -> Transform:
    """Return rect_T_velo, velo_link to the rectified camera 0.

    Raises:
        ValueError: The calibration has no r0_rect or cam0_T_velo.
    """
    if calibration.r0_rect is None or calibration.cam0_T_velo is None:
        raise ValueError('boxes need a calibration with r0_rect and cam0_T_velo')
    return Transform(calibration.r0_rect, np.zeros(3)) @ calibration.cam0_T_velo


def cuboids_of(labels: FrameLabels, calibration: Calibration) -> list[Cuboid]:
    """Return the 3D boxes of a frame in velo_link.

    Raises:
        ValueError: They are in the camera's frame, and the calibration has no transform from it.
    """
    if labels.cuboids:
        return list(labels.cuboids)
    solid = [
        (identity, box)
        for identity, box in identified(labels)
        if has_cuboid(box) and not is_absurd(box)
    ]
    if not solid:
        return []
    rect_t_velo = rect_from_velo(calibration)
    return [cuboid_of(box, identity, rect_t_velo) for identity, box in solid]


def identified(labels: FrameLabels) -> list[tuple[str, Box]]:
    """Return each box of a frame with its id: its track's, or its index in the file."""
    return [
        (str(index) if box.track_id is None else _track_identity(box.track_id, index), box)
        for index, box in enumerate(labels.boxes)
        if box is not None
    ]


def _track_identity(track_id: int, index: int) -> str:
    """Return the id of a box; DontCare regions all have track -1, so theirs is their index."""
    return str(track_id) if track_id >= 0 else f'{track_id}.{index}'


def has_complete_labels(layout: Layout, losses: Iterable[Loss]) -> bool:
    """Return whether a frame of a labelled recording has no object if it has no labels.

    Then the labels of all frames are in one file, and nothing of it is lost.

    Args:
        layout: Layout of the recording.
        losses: Its losses; those of a bag may concern labels if they name no other stream.
    """
    others = {stream.value for stream in Stream} - {Stream.LABELS.value}
    return layout.traits.common_labels and all(loss.stream in others for loss in losses)


class Trails:
    """The positions of all tracks of a recording, in the fixed frame of its poses."""

    def __init__(
        self,
        frames: Mapping[int, Sequence[Cuboid]],
        world_t_velo: Callable[[int], Transform | None],
    ) -> None:
        self._numbers: dict[int, list[int]] = {}
        self._positions: dict[int, list[Float64Array]] = {}
        for number in sorted(frames):
            pose = world_t_velo(number)
            for cuboid in frames[number] if pose is not None else ():
                if cuboid.track_id is not None and cuboid.track_id >= 0 and pose is not None:
                    self._numbers.setdefault(cuboid.track_id, []).append(number)
                    position = (pose @ cuboid.velo_T_box).translation
                    self._positions.setdefault(cuboid.track_id, []).append(position)

    def up_to(self, number: int) -> dict[int, Float64Array]:
        """Map the track ids of a frame to their positions up to it, (N, 3) metres in the world."""
        return {
            track: np.array(self._positions[track][: numbers.index(number) + 1])
            for track, numbers in self._numbers.items()
            if number in numbers
        }


# The nearest of known stamps.


def nearest_stamps(ordered_ns: Int64Array, stamps_ns: Int64Array) -> tuple[Int64Array, Int64Array]:
    """Return the index of the nearest of (N,) ascending stamps, and how much later (M,) are.

    Of two that are as near it is the earlier one.
    """
    after = np.minimum(np.searchsorted(ordered_ns, stamps_ns), len(ordered_ns) - 1)
    before = np.maximum(after - 1, 0)
    is_before = stamps_ns - ordered_ns[before] <= np.abs(ordered_ns[after] - stamps_ns)
    nearest = np.where(is_before, before, after)
    return nearest, stamps_ns - ordered_ns[nearest]


# Assignment of the samples of each stream to frames, by their stamps alone.

_Key = TypeVar('_Key')

NONE = -1
"""The index of a sample that a frame does not have."""
_LONE_PERIOD_NS = 100_000_000


@dataclass(frozen=True, eq=False)
class StreamMatch:
    """The assignment of the samples of a stream to frames.

    Attributes:
        indices: (N,) int64, for each frame the index of its sample, NONE where it has none.
        dropped: Number of samples without a frame.
        max_error_ns: Largest distance between a frame and its sample; 0 without matches.
        mean_error_ns: Their mean.
    """

    indices: Int64Array
    dropped: int
    max_error_ns: int
    mean_error_ns: float

    @property
    def matched(self) -> int:
        """Number of frames with a sample."""
        return int(np.count_nonzero(self.indices != NONE))


def match_frames(
    reference_ns: Int64Array, streams: Mapping[_Key, Int64Array], tolerance_ns: int
) -> dict[_Key, StreamMatch]:
    """Assign the nearest sample of each stream to each frame.

    Pairs are made in order of increasing distance: each sample goes to one frame at most, a pair is
    never further apart than the tolerance, and pairs do not cross, so samples stay in their order.
    Where two frames compete for a sample, the nearer one gets it (of two equally near ones the
    earlier); the other gets the sample on its other side, or none.

    Args:
        reference_ns: (N,) stamps of the frames, nanoseconds, in any order.
        streams: (M,) stamps of each stream, in any order.
        tolerance_ns: Nanoseconds, inclusive.
    """
    reference = np.asarray(reference_ns, dtype=np.int64)
    return {
        name: _match(reference, np.asarray(stamps_ns, dtype=np.int64), tolerance_ns)
        for name, stamps_ns in streams.items()
    }


def default_tolerance_ns(reference_ns: Int64Array) -> int:
    """Return half the median period of the frames, nanoseconds; of a single frame that of 10 Hz."""
    periods = np.diff(np.unique(reference_ns))
    return int(np.median(periods)) // 2 if len(periods) else _LONE_PERIOD_NS // 2


def _match(reference_ns: Int64Array, stamps_ns: Int64Array, tolerance_ns: int) -> StreamMatch:
    """Match one stream.

    In the merged order of frames and samples, the nearest pair always consists of neighbours, and
    once it is made no pair crosses it. So all pairs are chosen among neighbours alone.
    """
    count = len(reference_ns)
    stamps = np.concatenate([reference_ns, stamps_ns])
    # Equal stamps alternate, beginning with a frame.
    order = np.lexsort((np.concatenate([_turns(reference_ns), _turns(stamps_ns)]), stamps))
    gaps = np.diff(stamps[order])
    is_frame = order < count
    possible = (is_frame[1:] != is_frame[:-1]) & (gaps <= tolerance_ns)
    pair_starts = np.flatnonzero(possible)
    pair_starts = pair_starts[_nearest_first(pair_starts, gaps[pair_starts])]
    pairs = np.stack([order[pair_starts], order[pair_starts + 1]])
    frames, samples = pairs.min(axis=0), pairs.max(axis=0) - count
    indices = np.full(count, NONE, dtype=np.int64)
    indices[frames] = samples
    errors = gaps[pair_starts]
    return StreamMatch(
        indices,
        dropped=len(stamps_ns) - len(samples),
        max_error_ns=int(errors.max(initial=0)),
        mean_error_ns=float(errors.mean()) if len(errors) else 0.0,
    )


def _turns(stamps_ns: Int64Array) -> npt.NDArray[np.intp]:
    """Return for each stamp the number of equal stamps before it."""
    order = np.argsort(stamps_ns, kind='stable')
    ordered = stamps_ns[order]
    turns = np.empty(len(order), dtype=np.intp)
    turns[order] = np.arange(len(order)) - np.searchsorted(ordered, ordered)
    return turns


def _nearest_first(indices: npt.NDArray[np.intp], gaps: Int64Array) -> npt.NDArray[np.bool_]:
    """Select pairs in order of increasing gap, each of which excludes its neighbours.

    Pairs at consecutive indices share a frame or a sample. A pair is made unless a nearer neighbour
    is made: along a slope of increasing gaps, from its lowest pair up, every other one; the pair on
    top of two slopes, if both leave it free.

    Args:
        indices: (K,) ascending.
        gaps: (K,) nanoseconds.
    """
    adjoining = np.diff(indices, prepend=-2) == 1
    change = np.diff(gaps, prepend=gaps[:1])
    above_the_last = adjoining & (change >= 0)
    above_the_next = np.roll(adjoining & (change < 0), -1)
    free_before = _steps_up(above_the_last) % 2 == 0
    free_after = _steps_up(above_the_next[::-1])[::-1] % 2 == 0
    mask: npt.NDArray[np.bool_] = free_before & free_after
    return mask


def _steps_up(above: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """Return for each the length of the run, including it, of values above the one before."""
    position = np.arange(len(above))
    return position - np.maximum.accumulate(np.where(above, 0, position))
