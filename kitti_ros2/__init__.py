# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
r"""KITTI in ROS 2, and in Python: recordings read, drawn, played, written to bags and back.

Everything that a user can cause or fix is a KittiRos2Error.

>>> import kitti_ros2
>>> recording = kitti_ros2.open('2011_09_26/2011_09_26_drive_0005_sync')  # a folder, or any bag
>>> for frame in recording:  # by number, read lazily
...     points = frame.points  # (N, 4) float32 in velo_link
>>> frame = recording.frame(1)  # by KITTI's file number; recording[1] is the second one
>>> frame.number, frame.stamp_ns
(1, 13...)
>>> frame.image(2).shape, frame.png(2)[:4]  # (H, W, 3) uint8 RGB; the bytes of the file
((..., ..., 3), b'\x89PNG')
>>> frame.pose.shape, frame.oxts.lat  # map_T_base, or None; the packet, or None
((4, 4), 4...)
>>> uv, depth = frame.calibration.project(frame.points, camera=2)
>>> again = frame.calibration.unproject(uv[depth > 1], depth[depth > 1], camera=2)
>>> map_T_velo = frame.transform('map', 'velo_link')  # any frame to any frame
>>> for each in frame.objects:
...     each.class_name, each.box, each.corners('map'), each.box_2d, each.track  # doctest: +SKIP
>>> recording.streams.keys()
dict_keys(['scan', 'image_2', ...])
>>> recording.calibration().cameras, recording.trajectory().map_T_base.shape
((0, 1, 2, 3), (..., 4, 4))
>>> report = kitti_ros2.to_bag(recording.path, 'drive.mcap', images='raw')
>>> reports = kitti_ros2.to_kitti('drive.mcap', 'dataset', layout='object')
>>> kitti_ros2.draw(frame, 'panel').shape  # .show() in a notebook
(..., ..., 3)
>>> kitti_ros2.write_scan('velodyne/000000.bin', frame.points)
>>> kitti_ros2.read_scan('velodyne/000000.bin').shape
(..., 4)
>>> kitti_ros2.encode(frame)['/kitti/oxts/imu'][0]  # topic: (type, CDR bytes)
'sensor_msgs/msg/Imu'
"""

from __future__ import annotations

from .model.lazy_names import lazy_names

# Importing typing takes some ms, in which Ctrl-C prints a traceback: __main__ is imported later.
TYPE_CHECKING = False
if TYPE_CHECKING:  # of what these modules hold, the names in __all__ are public
    from .api.arguments import *
    from .api.calibration import *
    from .api.conversions import *
    from .api.draw import *
    from .api.open_recording import *
    from .api.single_files import *
    from .model.boxes import *
    from .model.errors import *
    from .model.samples import *

    __version__: str

_MODULES = {
    'Box': 'model.boxes',
    'CalibratedRig': 'api.calibration',
    'Frame': 'api.open_recording',
    'FrameObject': 'api.open_recording',
    'KittiRos2Error': 'model.errors',
    'KittiRos2Warning': 'api.arguments',
    'OxtsPacket': 'model.samples',
    'Picture': 'api.draw',
    'PoseSeries': 'api.open_recording',
    'Recording': 'api.open_recording',
    'draw': 'api.draw',
    'encode': 'api.conversions',
    'open': 'api.open_recording',
    'read_calibration': 'api.calibration',
    'read_image': 'api.single_files',
    'read_labels': 'api.single_files',
    'read_oxts': 'api.single_files',
    'read_point_labels': 'api.single_files',
    'read_poses': 'api.single_files',
    'read_scan': 'api.single_files',
    'read_stamps': 'api.single_files',
    'read_tracklets': 'api.single_files',
    'read_world_boxes': 'api.single_files',
    'to_bag': 'api.conversions',
    'to_kitti': 'api.conversions',
    'write_calibration': 'api.calibration',
    'write_image': 'api.single_files',
    'write_labels': 'api.single_files',
    'write_oxts': 'api.single_files',
    'write_point_labels': 'api.single_files',
    'write_poses': 'api.single_files',
    'write_scan': 'api.single_files',
    'write_stamps': 'api.single_files',
    'write_tracklets': 'api.single_files',
}

__all__ = [
    'Box',
    'CalibratedRig',
    'Frame',
    'FrameObject',
    'KittiRos2Error',
    'KittiRos2Warning',
    'OxtsPacket',
    'Picture',
    'PoseSeries',
    'Recording',
    'draw',
    'encode',
    'open',
    'read_calibration',
    'read_image',
    'read_labels',
    'read_oxts',
    'read_point_labels',
    'read_poses',
    'read_scan',
    'read_stamps',
    'read_tracklets',
    'read_world_boxes',
    'to_bag',
    'to_kitti',
    'write_calibration',
    'write_image',
    'write_labels',
    'write_oxts',
    'write_point_labels',
    'write_poses',
    'write_scan',
    'write_stamps',
    'write_tracklets',
]


_PACKAGES = ('datasets', 'evaluation')
_load = lazy_names(__name__, _MODULES)


def _load_any(name: str) -> object:
    if name in _PACKAGES:
        from importlib import import_module  # noqa: PLC0415 - as in lazy_names

        return import_module(f'{__name__}.{name}')
    if name != '__version__':
        return _load(name)
    from importlib import metadata  # noqa: PLC0415 - 22 ms

    try:
        return metadata.version(__name__)
    except metadata.PackageNotFoundError:
        return '0+not-installed'


if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = _load_any


def __dir__() -> list[str]:
    return sorted((*__all__, *_PACKAGES, '__version__'))
