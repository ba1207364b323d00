# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What several tests build on."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from kitti_ros2.kitti.label_file import parse_labels
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.camera_info import decode_static
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.own_bags.to_bag import ExportOptions, convert
from kitti_ros2.synthetic import SyntheticOptions

if TYPE_CHECKING:
    from kitti_ros2.model.boxes import Box
    from kitti_ros2.options.read import ReadOptions
    from kitti_ros2.own_bags.to_bag import ExportReport

SHARED = Path(__file__).resolve().parents[2] / 'shared'
"""Real files, beside the repository; absent on a user's machine."""

OF_OTHERS = [layout for layout in Layout if layout.traits.from_others]
"""The layouts that are made of bags of others."""

SMALL = SyntheticOptions(frames=5, image_size=(310, 94), lidar_columns=200)
"""The recording of the shared fixtures."""


def convert_recording(
    source: Path,
    out: Path,
    messages: MessageOptions | None = None,
    selection: SelectionOptions | None = None,
    *,
    read: ReadOptions | None = None,
    strict: bool = False,
    jobs: int = 1,
    **bag: Any,
) -> ExportReport:
    """Convert a recording; `bag` are fields of BagOptions."""
    return convert(
        open_recording(source, read),
        out,
        ExportOptions(
            messages or MessageOptions(),
            selection or SelectionOptions(),
            BagOptions(**bag),
            strict=strict,
        ),
        jobs=jobs,
    )


def parse_boxes(text: str, path: Path | str) -> list[Box]:
    """The boxes of a label file; the first line that is no label is raised as an error."""
    lines = parse_labels(text, path)
    for error in lines.errors.values():
        raise error
    return list(lines.sound().values())


def png_bytes(width: int, height: int, channels: int = 3) -> bytes:
    """A black PNG."""
    shape = (height, width, channels) if channels > 1 else (height, width)
    done, data = cv2.imencode('.png', np.zeros(shape, np.uint8))
    assert done
    return data.tobytes()


def files_of(folder: Path) -> dict[str, bytes]:
    """The files below a folder, by their names in it."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob('*')
        if path.is_file()
    }


def copied_drives(drive: Path, root: Path, count: int) -> Path:
    """Copies of a raw drive, numbered from 1, with the calibration of its date, in a new root."""
    date = root / drive.parent.name
    for number in range(1, count + 1):
        shutil.copytree(drive, date / drive.name.replace('0001', f'{number:04d}'))
    for path in drive.parent.glob('calib_*.txt'):
        shutil.copy(path, date)
    return root


def one_line(text: str) -> str:
    """The only line of what a command complained."""
    lines = text.splitlines()
    assert len(lines) == 1, text
    assert lines[0].startswith('kitti-ros2: ')
    assert 'Traceback' not in text
    return lines[0]


def seen_by(static: Any, info: Any, points: np.ndarray) -> np.ndarray:
    """(N, 3) points in velo_link as P takes them: in the frame of a CameraInfo, after R."""
    up = {child: (parent, transform) for parent, child, transform in decode_static(static)}
    frame, velo_t_camera = up[info.header.frame_id]
    while frame != 'velo_link':
        frame, transform = up[frame]
        velo_t_camera = transform @ velo_t_camera
    return velo_t_camera.inverse().apply(points) @ info.r.reshape(3, 3).T


def boxes_2d_in(message: Any) -> list[tuple[str, str, tuple[float, float, float, float]]]:
    """Id, class and (left, top, right, bottom) of each detection of a Detection2DArray."""
    found = []
    for detection in message.detections:
        place, box = detection.bbox.center.position, detection.bbox
        half = box.size_x / 2, box.size_y / 2
        bounds = place.x - half[0], place.y - half[1], place.x + half[0], place.y + half[1]
        found.append((detection.id, detection.results[0].hypothesis.class_id, bounds))
    return found
