# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The calibration of a frame: projection, its inverse, transforms, files."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.projection import Projection
from ..importer.box_labels import ImageOf, TrackIds, make_boxes
from ..kitti.calib_file import parse_calibration, parse_raw_calibration
from ..kitti.find import LAYOUTS
from ..kitti.store import STORE
from ..messages.camera_info import static_links
from ..messages.naming import LABELLED_CAMERA, make_frames
from ..messages.naming import base_t_imu as default_base_t_imu
from ..messages.tf_tree import FrameTree
from ..model.boxes import Cuboid
from ..model.errors import BadFileError, MissingDataError, UsageError
from ..model.geometry import NOMINAL_VELO_T_IMU, Transform, rotation_from_rpy
from ..model.samples import Calibration, CameraCalibration
from ..model.streams import Layout
from ..options.messages import MessageOptions, Preset
from .single_files import file_at

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import numpy.typing as npt

    from ..model.boxes import Box
    from ..model.geometry import Float64Array
    from .single_files import AnyPath


# The calibration of a frame: projection into images, its inverse, and transforms.


class CalibratedRig:
    """The calibration of cameras, scanner and GPS/IMU at one frame.

    Attributes:
        model: The numbers of KITTI's files: cameras (p_rect, k, d, ...), r0_rect, cam0_T_velo,
            velo_T_imu, and missing parts.
    """

    def __init__(
        self,
        model: Calibration,
        *,
        base_t_imu: Transform | None = None,
        camera_names: Mapping[int, str] | None = None,
    ) -> None:
        self.model = model
        self._base_t_imu = base_t_imu or default_base_t_imu(MessageOptions())
        self._frames = make_frames(Preset.DEFAULT, camera_names or {})

    @classmethod
    def from_matrices(
        cls,
        projections: Mapping[int, npt.ArrayLike],
        rect_T_velo: npt.ArrayLike,
        velo_T_imu: npt.ArrayLike | None = None,
    ) -> CalibratedRig:
        """Make the calibration of another rig, such as to write it to KITTI's files.

        Args:
            projections: KITTI's camera number to P, (3, 4): from the common rectified camera frame
                (x right, y down, z forward) to pixels of rectified images.
            rect_T_velo: (4, 4) or (3, 4): points of the scanner to that frame.
            velo_T_imu: (4, 4) or (3, 4): points of the GPS/IMU to the scanner's frame; KITTI's by
                default.

        Raises:
            KittiRos2Error: A matrix has another shape.
        """
        cameras = {
            index: CameraCalibration(_matrix(f'P{index}', p, ((3, 4),)))
            for index, p in projections.items()
        }
        extrinsics = _matrix('rect_T_velo', rect_T_velo, ((3, 4), (4, 4)))
        imu = NOMINAL_VELO_T_IMU
        if velo_T_imu is not None:
            imu = Transform.from_matrix(_matrix('velo_T_imu', velo_T_imu, ((3, 4), (4, 4))))
        return cls(Calibration(cameras, np.eye(3), Transform.from_matrix(extrinsics), imu))

    @property
    def cameras(self) -> tuple[int, ...]:
        """KITTI's numbers of the calibrated cameras."""
        return tuple(sorted(self.model.cameras))

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the coordinate frames of transform, besides map."""
        return tuple(sorted(self._tree.frames))

    def project(
        self, points: npt.ArrayLike, camera: int = LABELLED_CAMERA, frame: str | int = 'velo_link'
    ) -> tuple[Float64Array, Float64Array]:
        """Project points into the images of a camera.

        Rectified images: P_i R0_rect Tr_velo_to_cam x, as in the devkit's readme.txt. Unrectified
        images of raw extracts: K and distortion (plumb bob) of the camera. KITTI-360's fisheyes:
        the MEI model, which sees to the side and behind.

        Args:
            points: (N, 3) or more columns, of which x y z are used, metres.
            camera: KITTI's number.
            frame: Coordinate frame of the points, as in transform.

        Returns:
            (N, 2) float64 pixels u (right), v (down), (0, 0) the centre of the first pixel, NaN for
            points behind the camera; and (N,) float64 depth along the optical axis, metres, of
            fisheyes the distance. Pixels may be outside of the image.

        Raises:
            MissingDataError: The calibration of the camera is missing.
        """
        projection = self._projection(camera)
        xyz = np.asarray(points, np.float64)
        if xyz.ndim != 2 or xyz.shape[1] < 3:
            raise UsageError(f'points of shape {xyz.shape}; expected (N, 3) or more columns')
        xyz = xyz[:, :3]
        if frame != self._frames.velo:
            xyz = _move(xyz, self._to_velo(frame))
        seen = projection.homogeneous(xyz)
        return projection.pixels(seen), projection.depth(seen)

    def unproject(
        self,
        uv: npt.ArrayLike,
        depth: npt.ArrayLike,
        camera: int = LABELLED_CAMERA,
        frame: str | int = 'velo_link',
    ) -> Float64Array:
        """Return the points at pixels and depths; the inverse of project.

        Args:
            uv: (N, 2) pixels.
            depth: (N,) metres along the optical axis; of fisheyes the distance.
            camera: KITTI's number.
            frame: Coordinate frame of the result, as in transform.

        Returns:
            (N, 3) float64, metres.

        Raises:
            MissingDataError: The calibration of the camera is missing.
        """
        xyz = self._projection(camera).points(
            np.asarray(uv, np.float64), np.asarray(depth, np.float64)
        )
        return _move(xyz, self.transform(frame, self._frames.velo))

    def transform(
        self,
        target: str | int,
        source: str | int,
        map_T_base: npt.ArrayLike | None = None,
    ) -> Float64Array:
        """Return target_T_source, (4, 4) float64: maps points given in source to target.

        Args:
            target: base_link, imu_link, velo_link, an optical frame by its name, or KITTI's number
                of a camera (x right, y down, z forward; of rectified images all cameras are
                parallel to the rectified camera 0). map, if the pose is given.
            source: A coordinate frame, as target.
            map_T_base: The pose of the frame, (4, 4).

        Raises:
            MissingDataError: A frame is unknown or not connected.
        """
        if target == source:
            return np.eye(4)
        tree = self._tree
        if map_T_base is not None:
            map_t_base = Transform.from_matrix(map_T_base)
            tree = FrameTree([*self._links, (self._frames.map, self._frames.base, map_t_base)])
        names = (self._name(frame) for frame in (target, source))
        return tree.transform(*names).matrix()

    def label(
        self,
        class_name: str,
        box: npt.ArrayLike,
        size: tuple[int, int],
        *,
        score: float | None = None,
        track: int | None = None,
        occluded: int = 0,
        camera: int = LABELLED_CAMERA,
    ) -> Box:
        """Make a line of a KITTI label or result file from a box in velo_link.

        The projected corners give its 2D box and its truncation.

        Args:
            class_name: A word, such as Car.
            box: (7,) centre x y z, length, width, height in metres, yaw in radians, as
                FrameObject.box, OpenPCDet and mmdetection3d have it.
            size: (width, height) of the image, pixels.
            score: Score of a detection.
            track: Identity across frames.
            occluded: 0 visible, 1 partly, 2 largely, 3 unknown, which evaluations leave out.
            camera: KITTI's number of the camera of the 2D box.

        Raises:
            MissingDataError: The calibration of the camera is missing.
        """
        x, y, z, length, width, height, yaw = np.asarray(box, np.float64).tolist()
        pose = Transform(rotation_from_rpy(0.0, 0.0, yaw), np.array([x, y, z]))
        identity = '0' if track is None else str(track)
        cuboid = Cuboid(class_name, identity, pose, (length, width, height), score, track)
        self._projection(camera)
        (box_label,), _ = make_boxes(
            [cuboid],
            self.model,
            ImageOf(camera, size),
            TrackIds(),
            out_of_view=True,
            occluded=occluded,
        )
        return replace(box_label, track_id=track)

    @property
    def _links(self) -> list[tuple[str, str, Transform]]:
        return static_links(self.model, self._base_t_imu, self._frames)

    @property
    def _tree(self) -> FrameTree:
        return FrameTree(self._links)

    def _name(self, frame: str | int) -> str:
        return frame if isinstance(frame, str) else self._frames.camera(frame)

    def _to_velo(self, frame: str | int) -> Float64Array:
        return self.transform(self._frames.velo, frame)

    def _projection(self, camera: int) -> Projection:
        try:
            return Projection.of(self.model, camera)
        except ValueError as error:
            reason = next(iter(self.model.missing.values()), str(error))
            raise MissingDataError(f'camera {camera}: {reason}') from None

    def __repr__(self) -> str:
        return f'<kitti_ros2.CalibratedRig of cameras {", ".join(map(str, self.cameras))}>'


def _move(points: Float64Array, matrix: Float64Array) -> Float64Array:
    target_points: Float64Array = points @ matrix[:3, :3].T + matrix[:3, 3]
    return target_points


def _matrix(name: str, values: npt.ArrayLike, shapes: tuple[tuple[int, int], ...]) -> Float64Array:
    matrix = np.asarray(values, np.float64)
    if matrix.shape not in shapes:
        expected = ' or '.join(map(str, shapes))
        raise UsageError(f'{name} of shape {matrix.shape}; expected {expected}')
    return matrix


# Reading and writing of calibrations, in the form of each layout.


def read_calibration(path: AnyPath) -> CalibratedRig:
    """Read a calibration in any of KITTI's forms.

    Args:
        path: calib/*.txt (object, tracking), calib.txt (odometry), or the date's folder of a raw
            drive with its three files.

    Raises:
        KittiRos2Error: A file is missing or invalid.
    """
    with file_at(path) as file:
        if file.is_dir():
            calibration = _parse_folder(file)
        else:
            calibration = parse_calibration(STORE.read_text(file), file, file.name)
        for reason in calibration.missing.values():
            raise BadFileError(file, reason, 'a whole calibration')
        return CalibratedRig(calibration)


def _parse_folder(folder: Path) -> Calibration:
    """Parse a calibration of several files, of the first layout that has any of them."""
    for files in LAYOUTS.values():
        there = [name for name in files.calibration_files if (folder / name).is_file()]
        if there and files.parse_calibration is not None:
            texts = {name: STORE.read_text(folder / name) for name in there}
            return files.parse_calibration(texts, folder, True)  # noqa: FBT003 - as the row has it
    return parse_raw_calibration({}, folder, rectified=True)


def write_calibration(
    path: AnyPath, calibration: CalibratedRig, layout: str | Layout = Layout.OBJECT
) -> None:
    """Write a calibration in the form of a layout; the inverse of read_calibration.

    Args:
        path: The file; for raw the folder of the date, where three files are written.
        calibration: At least one camera, and the transform of the scanner. Loaders read four
            cameras, so an absent one gets the projection of the first.
        layout: object, tracking, odometry or raw.

    Raises:
        KittiRos2Error: A part of the calibration is missing, or the file cannot be written.
    """
    try:
        files = LAYOUTS[Layout(layout)].format_calibration(calibration.model)
    except ValueError as error:
        raise UsageError(f'{path}: {error}') from None
    with file_at(path) as file:
        for name, text in files.items():
            STORE.write_text(file / name if name else file, text)
