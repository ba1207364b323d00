# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI in ROS 2, and in Python: recordings read, drawn, played, written to bags and back.

    import kitti_ros2

    recording = kitti_ros2.open('2011_09_26/2011_09_26_drive_0005_sync')
    for frame in recording:
        frame.number, frame.points, frame.image(2), frame.objects, frame.pose

Everything that a user can cause or fix is a `KittiRos2Error`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .api.calibration import CalibratedRig
    from .api.conversions import to_bag, to_kitti
    from .api.draw import Picture, draw
    from .api.files import (
        read_calibration,
        read_image,
        read_labels,
        read_oxts,
        read_point_labels,
        read_poses,
        read_scan,
        read_stamps,
        read_tracklets,
        write_calibration,
        write_image,
        write_labels,
        write_oxts,
        write_point_labels,
        write_poses,
        write_scan,
        write_stamps,
        write_tracklets,
    )
    from .api.frame import Frame
    from .api.messages import encode
    from .api.objects import FrameObject
    from .api.recording import PoseSeries, Recording, open  # noqa: A004
    from .api.source import KittiRos2Warning
    from .model.boxes import Box
    from .model.errors import KittiRos2Error
    from .model.samples import OxtsPacket

_NAMES = {
    'api.calibration': ('CalibratedRig',),
    'api.conversions': ('to_bag', 'to_kitti'),
    'api.draw': ('Picture', 'draw'),
    'api.files': (
        'read_calibration',
        'read_image',
        'read_labels',
        'read_oxts',
        'read_point_labels',
        'read_poses',
        'read_scan',
        'read_stamps',
        'read_tracklets',
        'write_calibration',
        'write_image',
        'write_labels',
        'write_oxts',
        'write_point_labels',
        'write_poses',
        'write_scan',
        'write_stamps',
        'write_tracklets',
    ),
    'api.frame': ('Frame',),
    'api.messages': ('encode',),
    'api.objects': ('FrameObject',),
    'api.recording': ('PoseSeries', 'Recording', 'open'),
    'api.source': ('KittiRos2Warning',),
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
