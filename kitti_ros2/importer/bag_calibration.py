# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The calibrations of a plan: from CameraInfo and static transforms, or from their source."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from ..files.remote import as_path
from ..kitti import names
from ..kitti.archives import day_of_drive
from ..kitti.calib_file import parse_calibration, parse_raw_calibration
from ..kitti.kitti360_calib import parse_kitti360_calibration
from ..kitti.store import STORE
from ..messages.camera_info import PLUMB_BOB, RATIONAL
from ..messages.naming import CALIBRATION, PRESETS
from ..messages.rectified_cameras import angle_of, viewpoints
from ..messages.tf_tree import AXES, find_body, known_heading
from ..model.bag_formats import TF_TYPES
from ..model.errors import BadFileError, Loss, MissingDataError, UsageError
from ..model.geometry import NOMINAL_CAM0_T_VELO, NOMINAL_VELO_T_IMU, Transform
from ..model.samples import LEFT_OF, Calibration, CameraCalibration
from ..model.streams import CAMERA_NAMES, Layout
from .bag_cameras import camera_of, of_images, other_cameras
from .plan import NONE, SOURCE, TF
from .survey import topic_of
from .tf_frames import is_up, optical_links, optical_name

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from ..messages.camera_info import CameraModel
    from ..messages.rectified_cameras import Viewpoint
    from ..messages.tf_tree import FrameTree, Link
    from ..model.geometry import Float64Array
    from ..model.samples import TextFile
    from .plan import CameraPlan, Plan, ScanPlan
    from .survey import Survey


# CameraInfo and static transforms -> a calibration as KITTI's files have it.
#
# KITTI's frame is the rectified frame of the lowest-numbered camera: its optical frame, turned by
# the R of its CameraInfo. P_i projects points of that frame to camera i's rectified pixels.


# R of seven digits, as KITTI's files have it, makes turns of up to 2e-7 of cameras that have none.
_PARALLEL_RAD = 1e-6
_REPORTED_TURN_RAD = np.radians(0.01)
_PLUMB_BOB_NUMBERS = 5
_SAME_BASELINE_M = 1e-5
_OFF_M = 5e-3
"""Of parallel cameras: those of KITTI's P that its transforms leave out are up to 3 mm."""


def make_calibration(
    tree: FrameTree,
    lidar_frame: str | None,
    cameras: Mapping[int, CameraModel],
    imu_frame: str | None,
    *,
    rectified: bool,
    straightened: Collection[int] = (),
    others: Sequence[CameraModel] = (),
) -> tuple[Calibration, tuple[str, ...]]:
    """Make the calibration of a rig; also return notes, a line each.

    Args:
        tree: The static transforms.
        lidar_frame: KITTI's velodyne frame; None for a rig without scanner.
        cameras: By KITTI index.
        imu_frame: KITTI's imu frame; None for a rig without one.
        rectified: Whether the images are; if not, KITTI's files must support their distortion.
        straightened: Cameras whose images are rectified among others that are not: KITTI's
            unrectified camera is then the rectified one, with its K and without distortion.
        others: As viewpoints.

    Raises:
        MissingDataError: There is no camera; the tree does not connect the frames; KITTI's files do
            not support a distortion.
    """
    if not cameras:
        raise MissingDataError(
            'no camera has a CameraInfo, so there is no calibration; set calibration: none in the'
            ' plan, or give --calib'
        )
    views, notes = viewpoints(tree, cameras, others)
    first = min(cameras)
    cam0_t_velo, velo_t_imu, nominal = _mountings(tree, views[first], lidar_frame, imu_frame)
    by_index = {}
    for index, model in sorted(cameras.items()):
        cam_t_cam0 = Transform.identity()
        if index != first:
            cam_t_cam0 = _between(tree, views[index], views[first])
        turn = model.r @ cam_t_cam0.rotation @ cameras[first].r.T
        p_rect = _projection(views[index].p, Transform(turn, model.r @ cam_t_cam0.translation))
        p_rect = _as_given(model, p_rect)
        k, d = _distorted(index, model, rectified=rectified or index in straightened)
        by_index[index] = CameraCalibration(p_rect, model.size, k, d, model.r, cam_t_cam0)
        if angle_of(turn) > _REPORTED_TURN_RAD:
            notes.append(
                f'camera {index} is turned by {np.degrees(angle_of(turn)):.3g} degrees against'
                f' camera {first}: P{index} holds the turn, so its left part is no plain K'
            )
    calibration = Calibration(
        by_index,
        r0_rect=cameras[first].r,
        cam0_T_velo=cam0_t_velo,
        velo_T_imu=velo_t_imu,
        rectified=rectified,
        nominal=nominal,
    )
    if straightened:
        calibration = _straightened(calibration, cameras, straightened)
    return calibration, tuple(notes)


def _straightened(
    rig: Calibration, models: Mapping[int, CameraModel], which: Collection[int]
) -> Calibration:
    """Return the rig with some unrectified cameras replaced by the rectified ones."""
    image_t_cam = {
        index: Transform(model.r if index in which else np.eye(3), np.zeros(3))
        for index, model in models.items()
    }
    first = image_t_cam[min(models)]
    cameras = {}
    for index, camera in rig.cameras.items():
        cam_t_image0 = None if camera.cam_T_cam0 is None else camera.cam_T_cam0 @ first.inverse()
        cameras[index] = replace(
            camera,
            cam_T_cam0=None if cam_t_image0 is None else image_t_cam[index] @ cam_t_image0,
            r_rect=models[index].r @ image_t_cam[index].rotation.T,
        )
        if index in which:
            k, d = models[index].p[:, :3], np.zeros(_PLUMB_BOB_NUMBERS)
            cameras[index] = replace(cameras[index], k=k, d=d)
    cam0_t_velo = None if rig.cam0_T_velo is None else first @ rig.cam0_T_velo
    r0_rect = cameras[min(models)].r_rect
    return replace(rig, cameras=cameras, r0_rect=r0_rect, cam0_T_velo=cam0_t_velo)


def rect_in_frame(
    tree: FrameTree, cameras: Mapping[int, CameraModel], others: Sequence[CameraModel] = ()
) -> tuple[str, Transform]:
    """Return a frame of the tree, and KITTI's rectified camera 0 in it (frame_T_rect).

    Others are as of viewpoints.
    """
    first = min(cameras)
    view = viewpoints(tree, cameras, others)[0][first]
    cam_t_rect = Transform(cameras[first].r.T.copy(), np.zeros(3))
    return view.frame, view.cam_T_frame.inverse() @ cam_t_rect


def _mountings(
    tree: FrameTree, view: Viewpoint, lidar_frame: str | None, imu_frame: str | None
) -> tuple[Transform, Transform, tuple[str, ...]]:
    """Return cam0_T_velo, velo_T_imu, and which of them are nominal.

    Without a scanner its nominal pose is used, and the pose of the imu relative to that.
    """
    nominal = []
    cam0_t_velo, velo_t_imu = NOMINAL_CAM0_T_VELO, NOMINAL_VELO_T_IMU
    if lidar_frame is not None:
        cam0_t_velo = view.cam_T_frame @ tree.transform(view.frame, lidar_frame)
    else:
        nominal.append('cam0_T_velo')
    if imu_frame is None:
        nominal.append('velo_T_imu')
    elif lidar_frame is not None:
        velo_t_imu = tree.transform(lidar_frame, imu_frame)
    else:
        cam0_t_imu = view.cam_T_frame @ tree.transform(view.frame, imu_frame)
        velo_t_imu = cam0_t_velo.inverse() @ cam0_t_imu
    return cam0_t_velo, velo_t_imu, tuple(nominal)


def _between(tree: FrameTree, view: Viewpoint, first: Viewpoint) -> Transform:
    """Return cam_T_cam0 of two viewpoints."""
    frame_t_first = tree.transform(view.frame, first.frame)
    return view.cam_T_frame @ frame_t_first @ first.cam_T_frame.inverse()


def _projection(p: Float64Array, rect_T_rect0: Transform) -> Float64Array:
    """Return (3, 4) P for points of the rectified camera 0; without a rotation, K is unchanged."""
    k = p[:, :3]
    fourth = k @ rect_T_rect0.translation + p[:, 3]
    if angle_of(rect_T_rect0.rotation) > _PARALLEL_RAD:
        k = k @ rect_T_rect0.rotation
    return np.column_stack([k, fourth])


def _as_given(model: CameraModel, p_rect: Float64Array) -> Float64Array:
    """Return P of a rectified frame if it is for points of the rectified camera 0, to the bit.

    pykitti's transforms, and so kitti2mcap's, have p[0, 3] / p[0, 0] alone of the offset.
    """
    p, has_turn = model.p, angle_of(model.r) > _PARALLEL_RAD
    kept = has_turn and model.is_as_rectified and np.array_equal(p[:, :3], p_rect[:, :3])
    if not kept or not p[0, 3]:
        return p_rect
    off = p[:, 3] - p_rect[:, 3]
    same = abs(off[0]) < _SAME_BASELINE_M * p[0, 0]
    return p if same and np.abs(np.linalg.solve(p[:, :3], off)).max() < _OFF_M else p_rect


def _distorted(
    index: int, model: CameraModel, *, rectified: bool
) -> tuple[Float64Array | None, Float64Array | None]:
    """Return K and D as KITTI has them: plumb_bob of five numbers; None where neither is needed.

    Raises:
        MissingDataError: The images have another distortion.
    """
    # The rational polynomial's denominator is 1 where its last three numbers are 0.
    plain = model.model == PLUMB_BOB or (
        model.model == RATIONAL and not model.d[_PLUMB_BOB_NUMBERS:].any()
    )
    if plain and not model.d[_PLUMB_BOB_NUMBERS:].any():
        d = np.zeros(_PLUMB_BOB_NUMBERS)
        d[: len(model.d)] = model.d[:_PLUMB_BOB_NUMBERS]
        return model.k, d
    if rectified:
        return None, None
    raise MissingDataError(
        f'camera {index} is distorted by {model.model} of {len(model.d)} numbers, and KITTI has a'
        f' place for plumb_bob of 5; set rectify: true in the plan'
    )


# KITTI's camera 0 in bags of KITTI's recordings that have no images of it.
#
# Objects and tracks have images of cameras 2 and 3 alone, but labels, poses and P are for points of
# camera 0, whose frame the static transforms have by KITTI's name.

_KITTI_FRAMES = [
    {index: naming.frames_of({}).camera(index) for index in CAMERA_NAMES}
    for naming in PRESETS.values()
]
_KITTI_360 = Layout.KITTI_360.traits.camera_names
_KITTI_FRAMES += [
    {index: naming.frames_of(_KITTI_360).camera(index % 2) for index in CAMERA_NAMES}
    for naming in PRESETS.values()
]
"""KITTI-360's cameras 0 and 1 are both pairs."""


def link_to_camera_0(tree: FrameTree, cameras: Mapping[int, CameraModel]) -> Sequence[Link]:
    """Return the link to KITTI's camera 0 in bags of kitti2mcap without it; none in others.

    pykitti, and so kitti2mcap, moves cameras by p[0, 3] / p[0, 0] from camera 0.
    """
    first = cameras[min(cameras)]
    frame = _kitti_frames(cameras).get(0, '')
    if not frame or frame in tree.frames or not first.is_as_rectified or not first.p[0, 3]:
        return ()
    away = np.array([first.p[0, 3] / first.p[0, 0], 0.0, 0.0])
    return ((first.frame, frame, Transform.from_translation(away)),)


def with_kitti_cameras(
    tree: FrameTree, cameras: Mapping[int, CameraModel]
) -> Mapping[int, CameraModel]:
    """Add KITTI's cameras of which the tree has the frame alone, if camera 0 is one of them.

    Rectified cameras look the same way with the same K, so nothing but the frame is missing.

    Args:
        tree: The static transforms.
        cameras: By KITTI index.
    """
    first = cameras[min(cameras)]
    plain = np.column_stack([first.p[:, :3], np.zeros(3)])
    added = {}
    for index, frame in _kitti_frames(cameras).items():
        pose = tree.find(first.frame, frame)
        if index not in cameras and pose is not None and angle_of(pose.rotation) <= _PARALLEL_RAD:
            added[index] = replace(first, frame=frame, p=plain)
    return {**cameras, **added} if 0 in added else cameras


def _kitti_frames(cameras: Mapping[int, CameraModel]) -> Mapping[int, str]:
    """Return KITTI's frame names if cameras have them, and are rectified; none for others."""
    rectified = (
        angle_of(model.r) <= _PARALLEL_RAD or model.is_as_rectified for model in cameras.values()
    )
    same = (frames for frames in _KITTI_FRAMES if _are_named(cameras, frames))
    return next(same, {}) if all(rectified) else {}


def _are_named(cameras: Mapping[int, CameraModel], frames: Mapping[int, str]) -> bool:
    """Return whether each camera has its frame, or that of the left one of its pair."""
    return all(
        model.frame in (frames.get(index), frames.get(LEFT_OF.get(index, index)))
        for index, model in cameras.items()
    )


# KITTI's velodyne frame: the scanner's origin, x forward, y left, z up.
#
# A plan names a frame of the tree, or has one made: `scan.forward` is a frame whose orientation the
# scans get, the axis of `scan.frame` that looks forward, or camera: the direction of camera 2 on
# the ground. A made frame is one more static link, so that points, calibration, labels and poses
# agree.

CAMERA = 'camera'
"""The value of scan.forward that turns the scans to camera 2."""

LEVEL = np.sin(np.radians(15))
"""Cameras that look up or down more steeply than its complement have no direction on the ground."""


def make_forward_frame(
    plan: Plan,
    tree: FrameTree,
    models: Mapping[int, CameraModel],
    others: Sequence[CameraModel],
) -> tuple[Plan, Sequence[Link]]:
    """Return the plan with the made frame as scan.frame, and the link to it; neither if none is.

    Args:
        plan: The plan.
        tree: The static transforms.
        models: The cameras with a CameraInfo, by KITTI index.
        others: The other cameras of the bag, as viewpoints.

    Raises:
        UsageError: scan.forward is neither camera nor an axis nor a frame that is joined to
            scan.frame; or it is camera, and the camera has no direction on the ground.
        MissingDataError: It is camera, and no static transform joins the camera to scan.frame.
    """
    scan = plan.scan
    if scan is None or not scan.forward:
        return plan, ()
    rotation = AXES.get(scan.forward)
    if scan.forward == CAMERA:
        if plan.calibration != TF or not models:
            raise UsageError(
                f'scan: forward: {CAMERA}; expected calibration: {TF} and a camera with a'
                f' CameraInfo'
            )
        rotation = _forward_axes(optical_axis(tree, scan.frame, models, others), tree, scan)
    if rotation is None:
        scan_t_forward = tree.find(scan.frame, scan.forward)
        if scan_t_forward is None:
            raise UsageError(
                f'scan: forward: {scan.forward}; expected {", ".join(AXES)}, {CAMERA}, or a frame'
                f' that static transforms join to {scan.frame}; the bag has {tree}'
            )
        rotation = scan_t_forward.rotation
    name = f'{scan.frame} with {scan.forward} forward'
    link = (scan.frame, name, Transform(rotation.copy(), np.zeros(3)))
    return replace(plan, scan=replace(scan, frame=name, forward='')), (link,)


def optical_axis(
    tree: FrameTree,
    frame_id: str,
    models: Mapping[int, CameraModel],
    others: Sequence[CameraModel],
) -> Float64Array:
    """Return (3,) the optical axis of KITTI's rectified camera 0 in a frame.

    Camera 2 has the same: both are rectified to one plane.

    Raises:
        MissingDataError: No static transform joins the two.
    """
    own, frame_t_rect = rect_in_frame(tree, models, others)
    axis = tree.transform(frame_id, own).rotation @ frame_t_rect.rotation[:, 2]
    return np.asarray(axis, np.float64)


def _forward_axes(axis: Float64Array, tree: FrameTree, scan: ScanPlan) -> Float64Array:
    """Return (3, 3) forward, left, up in the frame of the scans, forward along an optical axis."""
    up = _vertical(tree, scan.frame)
    ahead = axis - up * (up @ axis)
    if np.linalg.norm(ahead) < LEVEL:
        side = 'up' if up @ axis > 0 else 'down'
        raise UsageError(
            f'scan: forward: {CAMERA}; the camera looks {side} in {scan.frame}: expected one that'
            f' looks to a side, or another forward'
        )
    ahead /= np.linalg.norm(ahead)
    return np.column_stack([ahead, np.cross(up, ahead), up])


def _vertical(tree: FrameTree, frame_id: str) -> Float64Array:
    """Return (3,) up in a frame: its z, or the robot's where z is not up."""
    heading = find_body(tree, [frame_id]) or known_heading(tree, frame_id)
    axes = None if heading is None else heading.axes_of(tree, frame_id)
    return np.array([0.0, 0, 1]) if axes is None or is_up(axes) else axes[2]


class PlannedRig:
    """The cameras and the static transforms of a plan.

    Attributes:
        plan: With the made frame as scan.frame: see made_frame.
        survey: The survey of its bags.
        models: The cameras with a CameraInfo, by KITTI index.
        calibrated: These, and KITTI's that have no images.
        others: The other cameras of the bag, as viewpoints.
        tree: The static transforms, also to the frames that are made.
    """

    def __init__(self, plan: Plan, survey: Survey) -> None:
        """Take the cameras and the frames of a plan.

        Raises:
            UsageError: The plan names a missing topic, or needs a CameraInfo that is invalid.
            MissingDataError: As made_frame.
        """
        lost = next((topic.undecoded().text() for topic in survey.unreadable(*TF_TYPES)), '')
        self.survey = survey
        self.models = camera_models(plan, survey)
        self.others, links = other_cameras(plan, survey)
        optical = [*links, *optical_links(plan, survey)]
        self.tree = survey.tree_with(optical, lost)
        self.plan, made = make_forward_frame(plan, self.tree, self.models, self.others)
        only_kittis = not self.others or survey.kitti_360_camera
        may_be_kittis = self.models and only_kittis and plan.scan and not plan.is_extract
        if may_be_kittis:
            made = [*made, *link_to_camera_0(self.tree, self.models)]
        if made:
            self.tree = survey.tree_with([*optical, *made], lost)
        self.calibrated: Mapping[int, CameraModel] = self.models
        if may_be_kittis:
            self.calibrated = with_kitti_cameras(self.tree, self.models)


# The calibrations of a plan, from their source, and selection of the one valid at a frame.

_IMU_LINK = 'imu_link'
_MOUNTS = (*names.KITTI_360_CALIB[:3], 'P0', 'R0_rect')
"""Parts of KITTI-360's calibration that mounts are made of: files, and keys in them."""
_AHEAD = 0.7  # cosine: KITTI's imu has the axes of the scanner, but for a degree


@dataclass(frozen=True)
class Calibrations:
    """The calibrations of a recording.

    Attributes:
        since_ns: The stamp from which each is valid, ascending.
        values: The calibrations; none where the plan has none.
        notes: Notes.
    """

    since_ns: Sequence[int]
    values: Sequence[Calibration]
    notes: tuple[str, ...] = ()

    def at(self, stamp_ns: int) -> Calibration | None:
        """Return the one valid at a stamp; before the first it is the first."""
        if not self.values:
            return None
        return self.values[max(bisect_right(self.since_ns, stamp_ns) - 1, 0)]

    @property
    def first(self) -> Calibration | None:
        """The first, None without any."""
        return self.values[0] if self.values else None


def make_calibrations(rig: PlannedRig) -> Calibrations:
    """Make the calibrations of a plan.

    Raises:
        UsageError: The calibration that the plan names does not exist.
        MissingDataError: Static transforms or entries of the bag's files are missing.
        BadFileError: A calibration file cannot be read, or required entries are missing.
    """
    plan = rig.plan
    if plan.calibration == NONE:
        return Calibrations((), ())
    straightened = [index for index, camera in plan.cameras.items() if camera.rectify]
    if plan.is_extract and straightened and plan.calibration != TF:
        raise UsageError(
            f'camera {straightened[0]} has rectify: true, and {plan.name} is of unrectified images:'
            f' a calibration other than tf does not have the lens of its rectified ones; set'
            f' rectify: false, or name a drive that ends in _sync'
        )
    if plan.calibration == SOURCE:
        return _from_source(rig)
    if plan.calibration != TF:
        file_calibration = _from_path(plan.calibration, plan)
        return Calibrations((0,), (file_calibration,), file_calibration.notes)
    if not rig.models:
        raise UsageError('calibration: tf needs a camera with camera_info; set none, or --calib')
    scan_frame = plan.scan.frame if plan.scan is not None else None
    calibration, notes = make_calibration(
        rig.tree,
        scan_frame,
        rig.calibrated,
        plan.imu_frame or _imu_link(rig.tree, scan_frame),
        rectified=not plan.is_extract,
        straightened=straightened if plan.is_extract else (),
        others=rig.others,
    )
    return Calibrations((0,), (calibration,), notes)


def nominal_mounts(survey: Survey) -> tuple[Loss, ...]:
    """Return the mounts of KITTI-360's rig that its files lacked when to-bag wrote a bag.

    The static transforms have nominal ones in their place.
    """
    texts = {PurePosixPath(file.name).name: file.text for file in survey.other_rig}
    missing = parse_kitti360_calibration(texts, Path(CALIBRATION)).missing if texts else {}
    reasons = [missing[part] for part in _MOUNTS if part in missing]
    return tuple(
        Loss(CALIBRATION, 1, f'{reason}; the bag has a nominal value')
        for reason in dict.fromkeys(reasons)
    )


def _imu_link(tree: FrameTree, scan_frame: str | None) -> str | None:
    """Return the frame of a GPS/IMU without a topic: imu_link beside the scans, if x is ahead.

    None if there are several.
    """
    if scan_frame is None:
        return None
    named = [name for name in tree.frames if name.rpartition('/')[2] == _IMU_LINK]
    poses = {name: pose for name in named if (pose := tree.find(scan_frame, name)) is not None}
    near = [name for name, pose in poses.items() if pose.rotation.diagonal().min() > _AHEAD]
    return near[0] if len(poses) == len(near) == 1 else None


def _with_imu(calibration: Calibration, plan: Plan, tree: FrameTree) -> Calibration:
    """Return a calibration with velo_T_imu of the static transforms if it has none."""
    scan_frame = None if plan.scan is None else plan.scan.frame
    imu_frame = _imu_link(tree, scan_frame) if 'velo_T_imu' in calibration.nominal else None
    if scan_frame is None or imu_frame is None:
        return calibration
    nominal = tuple(part for part in calibration.nominal if part != 'velo_T_imu')
    return replace(calibration, velo_T_imu=tree.transform(scan_frame, imu_frame), nominal=nominal)


def _from_source(rig: PlannedRig) -> Calibrations:
    """Read the files in a bag written by to-bag: one a frame, one a sequence, or the raw three."""
    plan, survey = rig.plan, rig.survey
    if not survey.calibrations:
        raise UsageError(f'calibration: source, but the bag has no {CALIBRATION}')
    by_name = {PurePosixPath(file.name).name: file.text for _, file in survey.calibrations}
    texts = {name: text for name, text in by_name.items() if name in names.RAW_CALIB}
    folder = Path(CALIBRATION)
    if texts:
        calibration = parse_raw_calibration(texts, folder, rectified=not plan.is_extract)
        stamps, calibrations = [0], [calibration]
    else:
        changes = _changes(survey.calibrations)
        stamps = [stamp_ns for stamp_ns, _ in changes]
        calibrations = [
            parse_calibration(file.text, folder / file.name, file.name) for _, file in changes
        ]
    calibrations = [_with_imu(calibration, plan, rig.tree) for calibration in calibrations]
    for calibration in calibrations:
        missing = _missing_part(calibration, plan)
        if missing:
            raise MissingDataError(f'{missing}; set calibration of the plan, or give --calib')
    if len(calibrations) == 1 or plan.layout.traits.calibration_per_frame:
        return Calibrations(stamps, calibrations)
    note = (
        f'the calibration changes {len(calibrations) - 1} times within the recording;'
        f' layout {plan.layout.value} has a place for the first one only'
    )
    return Calibrations(stamps, calibrations, (note,))


def _changes(files: Sequence[tuple[int, TextFile]]) -> list[tuple[int, TextFile]]:
    """Return the files that differ from the one before."""
    texts = ['', *(file.text for _, file in files)]
    return [file for before, file in zip(texts, files, strict=False) if file[1].text != before]


def _from_path(text: str, plan: Plan) -> Calibration:
    path = as_path(text)
    if not text or not path.exists():
        raise UsageError(
            f'calibration: {text!r}: no such file or folder; expected {TF}, {SOURCE}, {NONE}, or'
            f' the path of a KITTI calibration'
        )
    if path.is_dir():
        texts = {
            name: STORE.read_text(path / name)
            for name in names.RAW_CALIB
            if (path / name).is_file()
        }
        day = day_of_drive(plan.name)
        calibration = parse_raw_calibration(texts, path, rectified=not plan.is_extract, day=day)
    else:
        calibration = parse_calibration(STORE.read_text(path), path, path.name)
    missing = _missing_part(calibration, plan)
    if missing:
        raise BadFileError(path, missing, 'a calibration of every stream of the plan')
    return calibration


def _missing_part(calibration: Calibration, plan: Plan) -> str:
    """Return the reason why the first required part is missing, empty where none is."""
    needed = [f'P{index}' for index in plan.cameras]
    needed += ['Tr_velo_to_cam', names.CALIB_VELO_TO_CAM] if plan.scan is not None else []
    return next((calibration.missing[part] for part in needed if part in calibration.missing), '')


def camera_models(plan: Plan, survey: Survey) -> dict[int, CameraModel]:
    """Return the models of the cameras with a CameraInfo.

    Raises:
        UsageError: The plan needs a CameraInfo that is invalid.
    """
    models = {}
    for index, camera in plan.cameras.items():
        if not camera.info:
            continue
        try:
            models[index] = _camera_model(camera, survey)
        except UsageError:
            if plan.calibration == TF or camera.rectify:
                raise
    return models


def swapped_sizes(rig: PlannedRig) -> list[str]:
    """Return a note on the cameras whose CameraInfo has width and height swapped."""
    infos = {index: rig.plan.cameras[index].info for index in sorted(rig.models)}
    names = [
        info
        for index, info in infos.items()
        if camera_of(rig.survey, info).size != rig.models[index].size
    ]
    if not names:
        return []
    return [f'{", ".join(names)}: width and height are swapped; the size of the images is taken']


def _camera_model(camera: CameraPlan, survey: Survey) -> CameraModel:
    try:
        model = camera_of(survey, camera.info)
    except ValueError as error:
        raise UsageError(
            f'{camera.info}: {error}; take the camera out of the plan, or give --calib (and'
            f' rectify: false where its images are rectified)'
        ) from None
    model = of_images(model, topic_of(survey, camera.topic))
    frame_id = optical_name(camera.frame or model.frame, camera.forward)
    return replace(model, frame=frame_id, turned=camera.rectify)
