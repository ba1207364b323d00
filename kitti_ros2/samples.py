# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording holds: streams, frozen samples, and the protocol every layout's reader follows.

A *stream* is one sensor's series. A *sample* is what one file (or one line) of it holds. A sample's
*number* is its KITTI file number: streams are paired by number, never by position in a listing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from .geometry import rotation_from_rpy

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from .boxes import Box, Cuboid
    from .geometry import Float64Array, Transform

Float32Array: TypeAlias = npt.NDArray[np.float32]
Int64Array: TypeAlias = npt.NDArray[np.int64]

CAMERA_COUNT = 5
CAMERA_NAMES = {0: 'gray_left', 1: 'gray_right', 2: 'color_left', 3: 'color_right'}
"""KITTI's cameras by index, as their topics and frames call them."""


class Layout(str, Enum):
    """The four shapes KITTI comes in."""

    RAW = 'raw'
    OBJECT = 'object'
    ODOMETRY = 'odometry'
    TRACKING = 'tracking'


class Stream(str, Enum):
    """The series of a recording; the order is the order of publishing at equal stamps."""

    RECORDING = 'recording'
    CALIBRATION = 'calibration'
    PATH = 'path'
    POSE = 'pose'
    OXTS = 'oxts'
    SCAN = 'scan'
    IMAGE_0 = 'image_0'
    IMAGE_1 = 'image_1'
    IMAGE_2 = 'image_2'
    IMAGE_3 = 'image_3'
    IMAGE_4 = 'image_4'
    LABELS = 'labels'

    @property
    def camera(self) -> int | None:
        """The KITTI camera index of an image stream, None for the others."""
        return int(self.value[-1]) if self.value.startswith('image_') else None


IMAGE_STREAMS: tuple[Stream, ...] = tuple(Stream(f'image_{i}') for i in range(CAMERA_COUNT))

FRAME_STREAMS = (
    Stream.SCAN,
    Stream.IMAGE_2,
    Stream.IMAGE_0,
    Stream.IMAGE_3,
    Stream.IMAGE_1,
    Stream.IMAGE_4,
    Stream.LABELS,
    Stream.OXTS,
    Stream.POSE,
)
"""The streams whose samples make frames.

Where a file number is the same moment in all streams, every number that one of them has is a frame.
Elsewhere (a raw extract) the samples of the first stream that has any are the frames.
"""


class Clock(str, Enum):
    """The meaning of a recording's stamps.

    UTC has date and time; RELATIVE has seconds from the start, at an assumed date; NOMINAL has no
    time at all, only the order of frames at an assumed rate.
    """

    UTC = 'utc'
    RELATIVE = 'relative'
    NOMINAL = 'nominal'


@dataclass(frozen=True)
class TextFile:
    """A text file carried verbatim, so that it can be written again to the byte.

    Attributes:
        name: Path relative to the recording's root, with forward slashes.
        text: The whole content, line ends untouched.
    """

    name: str
    text: str


@dataclass(frozen=True)
class Turn:
    """One turn of the scanner: clockwise seen from above, from straight behind to straight behind.

    Attributes:
        start_ns: When it faces straight behind; it faces forward half a turn later.
        length_ns: Nanoseconds.
        nominal: Whether the length is assumed, for want of start and end stamps.
    """

    start_ns: int
    length_ns: int
    nominal: bool = False

    @property
    def forward_ns(self) -> int:
        """When the scanner faces forward."""
        return self.start_ns + self.length_ns // 2


@dataclass(frozen=True, eq=False)
class Scan:
    """One sweep of the laser scanner.

    Attributes:
        points: (N, 4) float32: x y z in metres in velo_link (x forward, y left, z up), and
            reflectance 0..1.
        start_ns, end_ns: First and last firing of the sweep, where the layout has them.
        labels: (N,) uint32 of SemanticKITTI, low 16 bits class, high 16 instance, if asked for.
        lacks: What was asked for and cannot be had: name to the reason, a line.
        turn: When each direction was scanned; None where the points are of one moment, as in scans
            that KITTI has compensated for motion.
    """

    points: Float32Array
    start_ns: int | None = None
    end_ns: int | None = None
    labels: npt.NDArray[np.uint32] | None = None
    lacks: Mapping[str, str] = field(default_factory=dict)
    turn: Turn | None = None


@dataclass(frozen=True)
class Image:
    """One camera image, still encoded.

    Attributes:
        png: The file's own bytes.
        width, height: Pixels.
        channels: 1 (grey) or 3 (colour).
    """

    png: bytes = field(repr=False)
    width: int
    height: int
    channels: int


@dataclass(frozen=True)
class OxtsPacket:
    """One packet of the GPS/IMU unit: the 30 columns of KITTI's dataformat.txt, in its order.

    Positions in degrees and metres, angles in radians, velocities in m/s, accelerations in m/s^2
    (gravity included), rates in rad/s. x, y, z are the unit's own body axes (forward, left, up);
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
        """(3,) m/s along the body's axes (forward, left, up), from ve vn vu and the attitude.

        Not from vf vl vu: the data set's vl is positive to the right, whatever its dataformat.txt
        says (drive 0001: -ve sin(yaw) + vn cos(yaw) is -vl to 1 cm/s).
        """
        east_north_up = np.array([self.ve, self.vn, self.vu])
        body: Float64Array = rotation_from_rpy(self.roll, self.pitch, self.yaw).T @ east_north_up
        return body


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the vehicle is: imu_link in a fixed frame, and how it moves where that is known.

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


@dataclass(frozen=True, eq=False)
class Start:
    """The first readable pose of a recording; it decides where map is.

    Attributes:
        world_T_imu: The pose, in the reader's fixed frame.
        level: Whether the axes of that frame are east, north and up; False where the layout has no
            gravity (odometry).
    """

    world_T_imu: Transform
    level: bool


@dataclass(frozen=True)
class Description:
    """The recording as a whole.

    Attributes:
        values: What a reader of the bag needs to lay the recording out again; plain JSON values.
        files: Text files of the whole recording, verbatim.
        lacks: Those that cannot be read: name to the reason, a line.
    """

    values: Mapping[str, object]
    files: Sequence[TextFile] = ()
    lacks: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """One camera of a rig.

    Attributes:
        p_rect: (3, 4), projects points of the rectified camera 0 to this camera's rectified pixels;
            where cam_T_velo is set, points of this camera's own frame.
        size: (width, height) of its rectified images, where the layout tells.
        k, d: (3, 3) and (5,) of the unrectified camera (plumb bob), raw layout only.
        r_rect: (3, 3), its rectifying rotation, raw layout only.
        cam_T_cam0: Unrectified camera 0 to this unrectified camera, raw layout only.
        cam_T_velo: This camera's own extrinsics (Waymo in KITTI's shape), None on a KITTI rig.
    """

    p_rect: Float64Array
    size: tuple[int, int] | None = None
    k: Float64Array | None = None
    d: Float64Array | None = None
    r_rect: Float64Array | None = None
    cam_T_cam0: Transform | None = None
    cam_T_velo: Transform | None = None


@dataclass(frozen=True, eq=False)
class Calibration:
    """The rig at one time.

    Attributes:
        cameras: By KITTI camera index; a camera whose numbers are lacking is absent.
        r0_rect: (3, 3), unrectified to rectified camera 0 (KITTI's R0_rect, R_rect_00).
        cam0_T_velo: velo_link to unrectified camera 0 (KITTI's Tr_velo_to_cam).
        velo_T_imu: imu_link to velo_link (KITTI's Tr_imu_to_velo).
        rectified: Whether the images are rectified (False for raw extract).
        nominal: Attributes that are stated defaults because the layout does not tell them.
        lacks: What is not there and should be: part (P2, Tr_velo_to_cam) to the reason, a line.
        files: The files it came from, verbatim.
    """

    cameras: Mapping[int, CameraCalibration]
    r0_rect: Float64Array | None
    cam0_T_velo: Transform | None
    velo_T_imu: Transform
    rectified: bool = True
    nominal: tuple[str, ...] = ()
    lacks: Mapping[str, str] = field(default_factory=dict)
    files: tuple[TextFile, ...] = ()

    @property
    def independent_cameras(self) -> bool:
        """Whether each camera has extrinsics of its own instead of a common rectified frame."""
        return any(camera.cam_T_velo is not None for camera in self.cameras.values())


Sample: TypeAlias = (
    'Description | Scan | Image | OxtsPacket | Pose | Trajectory | FrameLabels | Calibration'
)


@dataclass(frozen=True, eq=False)
class FrameLabels:
    """The labelled objects of one frame.

    Attributes:
        boxes: As a label file has them, in the file's order; None where a line is bad.
        cuboids: As tracklets have them, in velo_link; a frame has these or boxes.
        source: The frame's lines verbatim, under their file's name; None for tracklets.
        lacks: Bad lines: where to the reason, a line.
    """

    boxes: Sequence[Box | None] = ()
    cuboids: Sequence[Cuboid] = ()
    source: TextFile | None = None
    lacks: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class StreamIndex:
    """Which samples a stream holds: file numbers, ascending, and their stamps, of one length."""

    numbers: Int64Array
    stamps_ns: Int64Array

    def __len__(self) -> int:
        return len(self.numbers)


@dataclass(frozen=True)
class Loss:
    """Something of the user's data that could not be used: what, how much of it, and why.

    Attributes:
        stream: Name of the stream or topic.
        count: Samples or messages.
        message: One line; {} stands for the numbers.
        numbers: File numbers, where they are known.
    """

    stream: str
    count: int
    message: str
    numbers: tuple[int, ...] = ()

    def within(self, lowest: int, highest: int) -> Loss | None:
        """The part of it between two file numbers, both included; all where none are known."""
        if not self.numbers:
            return self
        kept = tuple(number for number in self.numbers if lowest <= number <= highest)
        return Loss(self.stream, len(kept), self.message, kept) if kept else None

    def text(self) -> str:
        """The message with its numbers."""
        return self.message.replace('{}', format_numbers(self.numbers))


def runs_of(numbers: Iterable[int]) -> list[list[int]]:
    """Ascending numbers as [first, last] of each run without a gap."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return spans


def format_numbers(numbers: Sequence[int], most: int = 6) -> str:
    """Ascending numbers as ranges, such as ``3, 177-180 and 2 more``."""
    spans = runs_of(numbers)
    texts = [f'{first}' if first == last else f'{first}-{last}' for first, last in spans[:most]]
    rest = sum(last - first + 1 for first, last in spans[most:])
    return ', '.join(texts) + (f' and {rest} more' if rest else '')


class Recording(Protocol):
    """A KITTI recording open for reading: an index in memory, samples read one by one on demand.

    Attributes:
        layout: Which of the four layouts.
        name: A short name for people (drive, sequence or folder).
        root: The folder that the names of its text files are relative to.
        streams: What is there; a stream without a single sample is absent.
        cameras: Camera index to the camera's topic name part, such as color_left.
        image_topic: image_rect, or image_raw where the images are not rectified.
        common_numbers: Whether the same number is the same moment in all streams.
        turns: When each scan was made, by file number.
        clock: The meaning of its stamps.
        losses: What the listing already shows to be missing or unusable.
        notes: What is worth a word and no loss, such as a stream that is absent.
    """

    layout: Layout
    name: str
    root: Path

    @property
    def streams(self) -> Mapping[Stream, StreamIndex]:
        """What is there, by stream."""
        ...

    @property
    def cameras(self) -> Mapping[int, str]:
        """Camera index to the name in its topics and frames."""
        ...

    image_topic: str
    common_numbers: bool
    clock: Clock

    @property
    def turns(self) -> Mapping[int, Turn]:
        """The turn of each scan, by file number; none of scans compensated for motion."""
        ...

    @property
    def losses(self) -> Sequence[Loss]:
        """What the listing shows to be missing."""
        ...

    @property
    def late_losses(self) -> Sequence[Loss]:
        """What passes over many samples (path, trails, origin of the map) could not read so far.

        Nothing else names it: the sample itself may be left out, or be read at another time.
        """
        ...

    @property
    def notes(self) -> Sequence[str]:
        """What is worth a word and no loss."""
        ...

    def read(self, stream: Stream, number: int) -> Sample:
        """The sample of a stream with a file number.

        Raises:
            BadFileError: The file is cut, malformed or contradicts the rest.
            OSError: The file cannot be read.
        """
        ...

    def path(self, stream: Stream, number: int) -> Path:
        """The file a sample is read from."""
        ...

    def describe(self) -> Description:
        """The recording as a whole."""
        ...

    def calibration(self, number: int) -> Calibration:
        """The calibration that holds for a frame; what it lacks is named in it."""
        ...

    def trails(self, number: int) -> Mapping[int, Float64Array]:
        """Track id to where that track's middle was up to a frame, (N, 3) metres in the world.

        Tracks that the frame does not have are left out; all are, where there are no poses.
        """
        ...

    @property
    def start(self) -> Start | None:
        """The first readable pose of the whole recording, None without one."""
        ...

    def trajectory(self, numbers: Sequence[int]) -> Trajectory:
        """The poses of these numbers, those that cannot be read left out."""
        ...
