# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a conversion from a bag, as a user reads and edits it: topics and streams."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any

from ..model.boxes import VISIBLE
from ..model.layouts import Layout

if TYPE_CHECKING:
    from collections.abc import Mapping


TF = 'tf'
NONE = 'none'
SOURCE = 'source'
QUIET = 'quiet'
"""Metadata of the fields that a printed plan leaves out at their default."""


def _quiet(value: Any) -> Any:  # noqa: ANN401 - of the field
    return field(default=value, metadata={QUIET: True})


class Incomplete(str, Enum):
    """The treatment of a frame in which a stream has no sample."""

    DROP = 'drop'
    KEEP = 'keep'


class StampSource(str, Enum):
    """The stamps of all streams: of the messages' headers, or their log times."""

    HEADER = 'header'
    LOG = 'log'


class VelocityAxes(str, Enum):
    """The axes of a velocity: those of its frame, or east, north, up."""

    FRAME = 'frame'
    ENU = 'enu'


@dataclass(frozen=True)
class ScanPlan:
    """The source of the scans.

    Attributes:
        topic: A PointCloud2, CustomMsg (Livox), VelodyneScan, LaserScan or depth image.
        frame: The frame that becomes KITTI's velodyne frame (x forward, y left, z up); points are
            brought there by the static transforms where the messages are in another.
        intensity_scale: Divisor that scales intensities to 0..1.
        from_: What the scans are made from: cloud, livox, velodyne, laser_scan or depth; empty for
            what the topic's type is of.
        info: The CameraInfo of depth images, empty for none.
        model: The scanner of Velodyne packets: VLP-16, VLP-16-Hi-Res, VLP-32C, HDL-32E or HDL-64E;
            empty for the one that the packets name.
        calibration: The YAML file with the calibration of the scanner's unit, as the ROS driver
            reads it; required for a HDL-64E, empty for the angles of the model's manual.
        minimum_range_m: Returns nearer to the scanner are dropped, metres.
        unit_m: The unit of x y z in clouds, metres: 0.001 for millimetres.
        offset_s: Added to the stamps, seconds, where a clock is wrong.
        forward: Forward of the scans, where x of the frame is not: a frame of the static tree whose
            orientation they get (base_link), or the axis of the frame that looks forward: -x, y,
            -y (up is z) or z (up is -y, an optical frame); or camera, the direction that camera 2
            looks in on the ground (with camera_sets the camera of each set): programs that train on
            KITTI take it for x. The origin stays that of the frame. Empty: the frame as it is.
    """

    topic: str
    frame: str
    intensity_scale: float = 1.0
    from_: str = _quiet('')
    info: str = _quiet('')
    model: str = _quiet('')
    calibration: str = _quiet('')
    minimum_range_m: float = _quiet(0.0)
    unit_m: float = _quiet(1.0)
    offset_s: float = _quiet(0.0)
    forward: str = _quiet('')


@dataclass(frozen=True)
class CameraPlan:
    """The source of a camera's images.

    Attributes:
        topic: An Image or CompressedImage.
        info: Its CameraInfo, empty for none.
        rectify: Whether the images are rectified.
        frame: The optical frame, empty for the CameraInfo's own.
        forward: x where the frame is no optical one but has x forward and z up, as those of many
            simulators: the optical frame is made in it.
        offset_s: As of the scan.
    """

    topic: str
    info: str = ''
    rectify: bool = False
    frame: str = ''
    forward: str = _quiet('')
    offset_s: float = _quiet(0.0)


@dataclass(frozen=True)
class PosePlan:
    """The source of the vehicle's poses.

    Attributes:
        topic: An Odometry, PoseStamped, Path or TFMessage.
        body: The frame whose poses they are: of Odometry its child frame, or one that transforms
            join to it.
        world: The frame they are given in: that of the messages, or one that transforms join to it,
            such as map above odom.
        offset_s: As of the scan.
    """

    topic: str
    body: str
    world: str = ''
    offset_s: float = _quiet(0.0)


@dataclass(frozen=True)
class LabelPlan:
    """The source of the labels.

    Attributes:
        topic: A Detection3DArray, TrackedObjects or DetectedObjects (Autoware), a MarkerArray
            whose cubes are the boxes, a Detection2DArray for labels without 3D boxes, or the label
            lines that a bag written by to-bag contains.
        camera: The KITTI camera whose pixels the 2D boxes are.
        out_of_view: Whether boxes outside of the camera's view are kept.
        occluded: The occlusion written for boxes, whose messages have none: 0 visible, 1 partly, 2
            largely, 3 unknown. Evaluations leave 3 out (cpp/evaluate_object.cpp of the devkit).
            Label lines and tracklets in a bag written by to-bag have their own.
        boxes_2d: A Detection2DArray whose boxes are the 2D boxes of the labels, in pixels of the
            camera's images as they are in the bag; empty: the projections of the 3D boxes.
        classes: KITTI's class of each class of the topic, by name (in any case) or number. Those
            that are not listed have a default: see Classes of labels of the how-to.
        keep_classes: Whether classes without one of KITTI's keep their names, such as forklift;
            otherwise they become Misc.
        offset_s: As of the scan.
    """

    topic: str
    camera: int = 2
    out_of_view: bool = False
    occluded: int = VISIBLE
    boxes_2d: str = _quiet('')
    classes: Mapping[str, str] = field(default_factory=dict, metadata={QUIET: True})
    keep_classes: bool = _quiet(value=False)
    offset_s: float = _quiet(0.0)


@dataclass(frozen=True)
class Plan:
    """The rules by which bags are converted to a KITTI recording.

    Attributes:
        layout: Which of the four.
        name: Drive (2011_09_26_drive_0001_sync), split or sequence.
        reference: The stream whose samples are the frames: scan, image_N or pose.
        tolerance_s: Maximum distance of a sample from the stamp of its frame, seconds.
        incomplete: Whether frames without a message of a stream are dropped or kept; of a frame
            whose message cannot be decoded, the other files stay.
        scan: The source of the scans.
        cameras: The sources of images, by KITTI camera number.
        pose: The source of the poses.
        labels: The source of the labels.
        imu: Topic of an Imu for the packets of the GPS/IMU unit, empty for none.
        fix: Topic of a NavSatFix for the same, empty for none.
        velocity: Topic of a TwistStamped or an Odometry for the same, empty for none.
        velocity_axes: Those of its frame (frame), or east, north, up (enu): a receiver with one
            antenna does not know where it looks.
        imu_frame: The frame that becomes KITTI's imu frame (x forward, y left, z up).
        calibration: tf (CameraInfo and static transforms), source (the files in a bag written by
            to-bag), none, or a KITTI calibration file or folder.
        stamps: The stamps of all streams: header, or log (the times of recording) where the clocks
            of the sensors cannot be used.
        imu_offset_s: As offset_s of the scan, for imu.
        fix_offset_s: The same for fix.
        velocity_offset_s: The same for velocity.
        camera_sets: The sources of images of one data set a camera, by the sets' names, with the
            keys of a camera: it is camera 2 of its set, and scans and labels are in common
            (--all-cameras). Excludes cameras.
        origin: LAT,LON,ALT, degrees and metres, of the origin of poses that become oxts; empty for
            0,0,0.
    """

    layout: Layout
    name: str
    reference: str
    tolerance_s: float
    incomplete: Incomplete = Incomplete.DROP
    scan: ScanPlan | None = None
    cameras: Mapping[int, CameraPlan] = field(default_factory=dict)
    pose: PosePlan | None = None
    labels: LabelPlan | None = None
    imu: str = ''
    fix: str = ''
    velocity: str = ''
    velocity_axes: VelocityAxes = field(default=VelocityAxes.FRAME, metadata={QUIET: True})
    imu_frame: str = ''
    calibration: str = TF
    stamps: StampSource = field(default=StampSource.HEADER, metadata={QUIET: True})
    imu_offset_s: float = _quiet(0.0)
    fix_offset_s: float = _quiet(0.0)
    velocity_offset_s: float = _quiet(0.0)
    camera_sets: Mapping[str, CameraPlan] = field(default_factory=dict, metadata={QUIET: True})
    origin: str = ''
