# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The encoders of the table's rows: a sample and its moment to messages.

They return a message of a rosbags class or a serialised one, a list of several, or None if the
sample has no data for it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.objects import compared, is_missed, objects_of
from ..drawing.pixels import colour_pixels
from ..model.errors import MissingDataError
from ..model.labels import cuboids_of, identified
from .annotations import encode_annotations
from .autoware_objects import ObjectFrame, encode_detected_objects, encode_tracked_objects
from .camera_info import encode_camera_info, image_frame_camera
from .cdr import restamp, serialize
from .detections import encode_boxes_2d, encode_detections
from .image import encode_compressed, encode_pixels
from .map_frame import place_pose, place_trajectory
from .markers import encode_markers
from .moment import LABELLED_CAMERA
from .mounts import with_nominal_mounts
from .oxts import encode_imu
from .pose import encode_odometry, encode_path, encode_tf
from .prediction_markers import encode_prediction_markers
from .scan import encode_scan
from .source import encode_text
from .transforms import encode_static, static_links

if TYPE_CHECKING:
    from ..drawing.objects import LabelledObject
    from ..model.boxes import Cuboid
    from ..model.samples import (
        Calibration,
        Description,
        FrameLabels,
        Image,
        OxtsPacket,
        Pose,
        Scan,
        Trajectory,
    )
    from .cdr import Parts
    from .moment import Moment


def make_static(calibration: Calibration, moment: Moment) -> object:
    """Make the static tree, with nominal mounts of cameras where the calibration has none."""
    rig = moment.rig
    mounted = with_nominal_mounts(calibration, rig.cameras, own=rig.options.own_frames)
    links = static_links(mounted, rig.base_t_imu, rig.frames)
    return encode_static(links, moment.stamp_ns)


def make_files(sample: Calibration | Description, moment: Moment) -> list[object]:  # noqa: ARG001 - one form for all
    """Make a String of each text file of a calibration or a recording."""
    return [encode_text(file) for file in sample.files]


def make_source(sample: FrameLabels | OxtsPacket, moment: Moment) -> object | None:  # noqa: ARG001
    """Make a String of the text that a sample was read from."""
    return None if sample.source is None else encode_text(sample.source)


def make_path(trajectory: Trajectory, moment: Moment) -> object | None:
    """Make the Path of all poses in map."""
    if not trajectory.world_T_imu:
        return None
    placed = place_trajectory(trajectory, moment.rig.map_T_world)
    return encode_path(placed, moment.rig.base_t_imu, moment.stamp_ns, moment.rig.frames.map)


def make_odometry(pose: Pose, moment: Moment) -> object:
    """Make the Odometry of base_link in map."""
    frames = (moment.rig.frames.map, moment.rig.frames.truth)
    placed = place_pose(pose, moment.rig.map_T_world)
    return encode_odometry(placed, moment.rig.base_t_imu, moment.stamp_ns, frames)


def make_tf(pose: Pose, moment: Moment) -> object:
    """Make the transform map -> base_link."""
    frames = (moment.rig.frames.map, moment.rig.frames.truth)
    placed = place_pose(pose, moment.rig.map_T_world)
    return encode_tf(placed, moment.rig.base_t_imu, moment.stamp_ns, frames)


def make_imu(packet: OxtsPacket, moment: Moment) -> object:
    """Make the Imu of a packet, with covariances if the options request them."""
    return encode_imu(packet, *moment.at_imu, covariances=bool(moment.rig.options.covariances))


def make_scan(scan: Scan, moment: Moment) -> object:
    """Make the PointCloud2 of a scan, in the format that the options request."""
    options = moment.rig.options
    labels = scan.labels if options.semantic else None
    frame = moment.rig.frames.velo
    return encode_scan(scan, moment.stamp_ns, frame, options.cloud, labels, moment.remark)


def make_source_scan(scan: Scan, moment: Moment) -> object:
    """Make the PointCloud2 of a scan with the points of its file, unchanged."""
    return encode_scan(scan, moment.stamp_ns, moment.rig.frames.velo)


def make_compressed(image: Image, moment: Moment) -> object:
    """Make the CompressedImage of an image: the bytes of its file."""
    return encode_compressed(image, moment.stamp_ns, _image_frame(moment))


def make_image(image: Image, moment: Moment) -> object:
    """Make the Image of an image's pixels, of colour in the encoding that the options request."""
    encoding = moment.rig.options.color_encoding
    return encode_pixels(moment.pixels(image), moment.stamp_ns, _image_frame(moment), encoding)


def make_annotated(image: Image, moment: Moment) -> object:
    """Make the Image of an image with its frame's labels drawn on it."""
    from ..drawing.annotate import annotate  # noqa: PLC0415 - 0.2 s of OpenCV that others do without

    calibration = moment.calibration()
    picture = np.array(colour_pixels(moment.pixels(image)))
    labels = moment.labels()
    objects = [] if labels is None else objects_of(labels, calibration)
    annotate(picture, objects, calibration, moment.camera)
    return encode_pixels(picture, moment.stamp_ns, _image_frame(moment))


def make_annotations(image: Image, moment: Moment) -> object:
    """Make the ImageAnnotations of an image: the 2D boxes of its frame's labels."""
    labels = moment.labels()
    objects = [] if labels is None else objects_of(labels, moment.calibration())
    return _annotations(image, moment, objects, [])


def make_prediction_annotations(image: Image, moment: Moment) -> object:
    """Make the ImageAnnotations of predictions, compared with the labels if there are any."""
    predictions = moment.predictions()
    boxes = ([], []) if predictions is None else _compared_with_labels(predictions, moment)
    return _annotations(image, moment, *boxes)


def _annotations(
    image: Image,
    moment: Moment,
    objects: list[LabelledObject],
    predictions: list[LabelledObject],
) -> object:
    from ..drawing.image_boxes import image_boxes  # noqa: PLC0415 - as above

    size = image.width, image.height
    boxes = image_boxes(objects, predictions, moment.calibration(), moment.camera, size)
    return encode_annotations(boxes, moment.stamp_ns)


def make_camera_info(image: Image, moment: Moment) -> object:
    """Make the CameraInfo of an image."""
    calibration = moment.calibration()
    if moment.camera not in calibration.cameras:
        reason = _reason_without_camera(calibration, moment.camera)
        raise MissingDataError(f'{reason}; it is needed for camera_info')
    size = (image.width, image.height)
    stereo = moment.rig.options.stereo
    frame = _image_frame(moment)
    template = _camera_info_template(calibration, moment.camera, size, frame, stereo=stereo)
    return restamp(template, moment.stamp_ns)


def _reason_without_camera(calibration: Calibration, camera: int) -> str:
    missing = calibration.missing
    name = calibration.files[0].name if calibration.files else 'calibration'
    return missing.get(f'P{camera}') or missing.get('file') or f'{name}: no P{camera}'


def _image_frame(moment: Moment) -> str:
    own = moment.rig.options.own_frames
    return moment.rig.frames.camera(
        image_frame_camera(moment.calibration(), moment.camera, own=own)
    )


@lru_cache(maxsize=64)
def _camera_info_template(
    calibration: Calibration, camera: int, size: tuple[int, int], frame_id: str, *, stereo: bool
) -> Parts:
    """Return a camera's message, of which only the stamp differs between images."""
    return serialize(encode_camera_info(calibration, camera, size, 0, frame_id, stereo=stereo))


def make_detections(labels: FrameLabels, moment: Moment) -> object:
    """Make the Detection3DArray of a frame's labels or predictions."""
    return encode_detections(_cuboids(labels, moment), moment.stamp_ns, moment.rig.frames.velo)


def make_detected_objects(labels: FrameLabels, moment: Moment) -> object:
    """Make the DetectedObjects of a frame's labels or predictions."""
    cuboids = _cuboids(labels, moment)
    return encode_detected_objects(cuboids, moment.stamp_ns, _object_frame(moment))


def make_tracked_objects(labels: FrameLabels, moment: Moment) -> object | None:
    """Make the TrackedObjects of a frame's labels or predictions; None without tracks."""
    cuboids = _cuboids(labels, moment)
    tracked = any(each.track_id is not None for each in cuboids)
    if not (tracked or (moment.rig.tracked and not cuboids)):
        return None
    return encode_tracked_objects(cuboids, moment.stamp_ns, _object_frame(moment))


def _object_frame(moment: Moment) -> ObjectFrame:
    """Return base_link: Autoware's detectors and trackers work in the frame of the vehicle."""
    rig = moment.rig
    base_t_velo = rig.base_t_imu @ moment.calibration().velo_T_imu.inverse()
    return ObjectFrame(rig.frames.base, base_t_velo, dict(rig.options.autoware_labels))


def make_boxes_2d(labels: FrameLabels, moment: Moment) -> object | None:
    """Make the Detection2DArray of a frame's labels or predictions; None of tracklets.

    These have no 2D boxes.
    """
    if labels.source is None:
        return None
    frame = moment.rig.frames.camera(LABELLED_CAMERA)
    return encode_boxes_2d(identified(labels), moment.stamp_ns, frame)


def make_markers(labels: FrameLabels, moment: Moment) -> object:
    """Make the MarkerArray of a frame's labels."""
    options = moment.rig.options.markers
    found = moment.trails() if options.trails else {}
    trails = {track: moment.rig.map_T_world.apply(places) for track, places in found.items()}
    cuboids = _cuboids(labels, moment)
    return encode_markers(cuboids, trails, moment.stamp_ns, moment.rig.frames, options)


def make_prediction_markers(predictions: FrameLabels, moment: Moment) -> object:
    """Make the MarkerArray of a frame's predictions, compared with its labels if it has any."""
    _cuboids(predictions, moment)  # raises for a calibration without the scanner
    missed, found = _compared_with_labels(predictions, moment)
    frame, options = moment.rig.frames.velo, moment.rig.options.markers
    return encode_prediction_markers(missed, found, moment.stamp_ns, frame, options)


def _compared_with_labels(
    predictions: FrameLabels, moment: Moment
) -> tuple[list[LabelledObject], list[LabelledObject]]:
    """Return the labels that no prediction finds, and the predictions, both with their matches."""
    calibration, labels = moment.calibration(), moment.labels()
    found = objects_of(predictions, calibration)
    if labels is None:
        return [], found
    truth, found = compared(objects_of(labels, calibration), found, moment.rig.options.overlaps)
    return [each for each in truth if is_missed(each)], found


def _cuboids(labels: FrameLabels, moment: Moment) -> list[Cuboid]:
    calibration = moment.calibration()
    try:
        return _cuboids_once(labels, calibration)
    except ValueError as error:
        reason = next(iter(calibration.missing.values()), str(error))
        raise MissingDataError(f'{reason}; it is needed for the 3D boxes of labels') from None


@lru_cache(maxsize=16)
def _cuboids_once(labels: FrameLabels, calibration: Calibration) -> list[Cuboid]:
    """Return the cuboids of a frame, cached for several topics."""
    return cuboids_of(labels, calibration)
