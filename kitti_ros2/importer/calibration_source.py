# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The calibrations of a plan, from their source, and selection of the one valid at a frame."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from ..files.remote import as_path
from ..kitti import names
from ..kitti.calib_archives import day_of_drive
from ..kitti.calib_file import parse_calibration, parse_raw_calibration
from ..kitti.store import STORE
from ..messages.source import CALIBRATION
from ..model.errors import BadFileError, MissingDataError, UsageError
from .calibration import make_calibration
from .optical_frames import optical_name
from .plan import NONE, SOURCE, TF
from .planned_topics import camera_of, of_images, topic_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..messages.camera_info import CameraModel
    from ..model.samples import Calibration, TextFile
    from ..rig.tf_tree import FrameTree
    from .plan import CameraPlan, Plan
    from .survey import Survey

_UNIT_FRAME = 'imu_link'
_AHEAD = 0.7  # cosine: KITTI's unit has the axes of the scanner, but for a degree


@dataclass(frozen=True)
class Calibrations:
    """The calibrations of a recording.

    Attributes:
        since_ns: The stamp from which each is valid, ascending.
        values: The calibrations; none where the plan has none.
        notes: Non-fatal remarks.
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


def is_extract(plan: Plan) -> bool:
    """Whether the plan's images stay unrectified."""
    return plan.layout.traits.is_extract(plan.name)


def make_calibrations(
    plan: Plan,
    survey: Survey,
    tree: FrameTree,
    cameras: Mapping[int, CameraModel],
    others: Sequence[CameraModel],
) -> Calibrations:
    """Make the calibrations of a plan.

    Args:
        plan: The plan.
        survey: Of its bags.
        tree: The static transforms.
        cameras: The plan's, by KITTI index.
        others: As viewpoints.

    Raises:
        UsageError: The calibration that the plan names does not exist.
        MissingDataError: Static transforms or entries of the bag's files are missing.
        BadFileError: A calibration file cannot be read, or required entries are missing.
    """
    if plan.calibration == NONE:
        return Calibrations((), ())
    straightened = [index for index, camera in plan.cameras.items() if camera.rectify]
    if is_extract(plan) and straightened and plan.calibration != TF:
        raise UsageError(
            f'camera {straightened[0]} has rectify: true, and {plan.name} is of unrectified images:'
            f' a calibration other than tf does not have the lens of its rectified ones; set'
            f' rectify: false, or name a drive that ends in _sync'
        )
    if plan.calibration == SOURCE:
        return _from_source(plan, survey, tree)
    if plan.calibration != TF:
        given = _from_path(plan.calibration, plan)
        return Calibrations((0,), (given,), given.notes)
    if not cameras:
        raise UsageError('calibration: tf needs a camera with camera_info; set none, or --calib')
    scan_frame = plan.scan.frame if plan.scan is not None else None
    calibration, notes = make_calibration(
        tree,
        scan_frame,
        cameras,
        plan.imu_frame or _unit_frame(tree, scan_frame),
        rectified=not is_extract(plan),
        straightened=straightened if is_extract(plan) else (),
        others=others,
    )
    return Calibrations((0,), (calibration,), notes)


def _unit_frame(tree: FrameTree, scan_frame: str | None) -> str | None:
    """Return the frame of a GPS/IMU unit without a topic: imu_link beside the scans, if x is ahead.

    Of several none is known to be that of the unit.
    """
    if scan_frame is None:
        return None
    found = [each for each in tree.frames if each.rpartition('/')[2] == _UNIT_FRAME]
    places = {each: place for each in found if (place := tree.find(scan_frame, each)) is not None}
    near = [each for each, place in places.items() if place.rotation.diagonal().min() > _AHEAD]
    return near[0] if len(places) == len(near) == 1 else None


def _with_unit(calibration: Calibration, plan: Plan, tree: FrameTree) -> Calibration:
    """Return a calibration with the place of the unit in the static transforms if it has none."""
    frame = None if plan.scan is None else plan.scan.frame
    unit = _unit_frame(tree, frame) if 'velo_T_imu' in calibration.nominal else None
    if frame is None or unit is None:
        return calibration
    nominal = tuple(part for part in calibration.nominal if part != 'velo_T_imu')
    return replace(calibration, velo_T_imu=tree.transform(frame, unit), nominal=nominal)


def _from_source(plan: Plan, survey: Survey, tree: FrameTree) -> Calibrations:
    """Read the files in a bag written by to-bag: one a frame, one a sequence, or the raw three."""
    if not survey.calibrations:
        raise UsageError(f'calibration: source, but the bag has no {CALIBRATION}')
    by_name = {PurePosixPath(file.name).name: file.text for _, file in survey.calibrations}
    texts = {name: text for name, text in by_name.items() if name in names.RAW_CALIB}
    folder = Path(CALIBRATION)
    if texts:
        found = parse_raw_calibration(texts, folder, rectified=not is_extract(plan))
        stamps, values = [0], [found]
    else:
        changes = _changes(survey.calibrations)
        stamps = [stamp_ns for stamp_ns, _ in changes]
        values = [
            parse_calibration(file.text, folder / file.name, file.name) for _, file in changes
        ]
    values = [_with_unit(each, plan, tree) for each in values]
    for value in values:
        lacking = _lacking(value, plan)
        if lacking:
            raise MissingDataError(f'{lacking}; set calibration of the plan, or give --calib')
    if len(values) == 1 or plan.layout.traits.calibration_per_frame:
        return Calibrations(stamps, values)
    note = (
        f'the calibration changes {len(values) - 1} times within the recording;'
        f' layout {plan.layout.value} has a place for the first one only'
    )
    return Calibrations(stamps, values, (note,))


def _changes(files: Sequence[tuple[int, TextFile]]) -> list[tuple[int, TextFile]]:
    """Return the files that differ from the one before."""
    texts = ['', *(file.text for _, file in files)]
    return [entry for before, entry in zip(texts, files, strict=False) if entry[1].text != before]


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
        found = parse_raw_calibration(texts, path, rectified=not is_extract(plan), day=day)
    else:
        found = parse_calibration(STORE.read_text(path), path, path.name)
    lacking = _lacking(found, plan)
    if lacking:
        raise BadFileError(path, lacking, 'a calibration of every stream of the plan')
    return found


def _lacking(calibration: Calibration, plan: Plan) -> str:
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


def swapped_sizes(plan: Plan, survey: Survey, models: Mapping[int, CameraModel]) -> list[str]:
    """Return a note on the cameras whose CameraInfo has width and height swapped."""
    names = [
        plan.cameras[index].info
        for index, model in sorted(models.items())
        if camera_of(survey, plan.cameras[index].info).size != model.size
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
    frame = optical_name(camera.frame or model.frame, camera.forward)
    return replace(model, frame=frame, turned=camera.rectify)
