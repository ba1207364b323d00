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

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .api.calibration import CalibratedRig
    from .api.calibration_files import read_calibration, write_calibration
    from .api.conversions import to_bag, to_kitti
    from .api.draw import Picture, draw
    from .api.frame import Frame
    from .api.messages import encode
    from .api.objects import FrameObject
    from .api.open_recording import PoseSeries, Recording, open  # noqa: A004
    from .api.sensor_files import (
        read_image,
        read_point_labels,
        read_scan,
        write_image,
        write_point_labels,
        write_scan,
    )
    from .api.source import KittiRos2Warning
    from .api.text_files import (
        read_labels,
        read_oxts,
        read_poses,
        read_stamps,
        read_tracklets,
        write_labels,
        write_oxts,
        write_poses,
        write_stamps,
        write_tracklets,
    )
    from .model.boxes import Box
    from .model.errors import KittiRos2Error
    from .model.samples import OxtsPacket

_NAMES = {
    'api.calibration': ('CalibratedRig',),
    'api.calibration_files': ('read_calibration', 'write_calibration'),
    'api.conversions': ('to_bag', 'to_kitti'),
    'api.draw': ('Picture', 'draw'),
    'api.frame': ('Frame',),
    'api.messages': ('encode',),
    'api.objects': ('FrameObject',),
    'api.open_recording': ('PoseSeries', 'Recording', 'open'),
    'api.sensor_files': (
        'read_image',
        'read_point_labels',
        'read_scan',
        'write_image',
        'write_point_labels',
        'write_scan',
    ),
    'api.source': ('KittiRos2Warning',),
    'api.text_files': (
        'read_labels',
        'read_oxts',
        'read_poses',
        'read_stamps',
        'read_tracklets',
        'write_labels',
        'write_oxts',
        'write_poses',
        'write_stamps',
        'write_tracklets',
    ),
    'model.boxes': ('Box',),
    'model.errors': ('KittiRos2Error',),
    'model.samples': ('OxtsPacket',),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}

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


def __getattr__(name: str) -> object:
    """Import a public name when it is used first: the command line needs none of them."""
    from importlib import import_module, metadata  # noqa: PLC0415

    if name == '__version__':
        try:
            return metadata.version(__name__)
        except metadata.PackageNotFoundError:
            return '0+not-installed'
    if name not in _MODULES:
        message = f'module {__name__!r} has no attribute {name!r}'
        raise AttributeError(message)
    found = getattr(import_module(f'.{_MODULES[name]}', __name__), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
