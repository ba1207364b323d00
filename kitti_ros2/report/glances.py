# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The cameras and static transforms of a recording or a bag, as numbers for people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..bags.reader import open_messages
from ..messages.camera_info import encode_camera_info, image_frame_camera
from ..messages.cdr import deserialize
from ..messages.moment import make_rig
from ..messages.mounts import with_nominal_mounts
from ..messages.transforms import decode_static, static_links
from ..model.errors import KittiRos2Error
from ..model.geometry import rotation_to_rpy
from ..model.msgtypes import CAMERA_INFO, TF
from ..options.messages import MessageOptions

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from ..bags.reader import BagSummary, OpenBag
    from ..kitti.recording import KittiRecording
    from ..messages.ros_types import CameraInfo
    from ..model.geometry import Transform

_MOST_TF = 200


@dataclass(frozen=True)
class CameraGlance:
    """A camera's numbers: name, image size, focal lengths and centre in pixels, baseline in m.

    Unknown values are None: the size if only images have it, the rest of an uncalibrated camera.
    """

    name: str
    width: int | None
    height: int | None
    fx: float | None
    fy: float | None
    cx: float | None
    cy: float | None
    baseline_m: float | None

    def cells(self) -> tuple[str, ...]:
        """Format name, fx, fy, cx, cy and baseline for a table; what is unknown is empty."""
        pixels = (self.fx, self.fy, self.cx, self.cy)
        return (
            self.name.removesuffix('/camera_info'),
            *('' if value is None else f'{value:.2f}' for value in pixels),
            f'{self.baseline_m:.4f}' if abs(self.baseline_m or 0) > 1e-6 else '',
        )


@dataclass(frozen=True)
class LinkGlance:
    """A static transform: child in parent, xyz in metres, roll pitch yaw in degrees."""

    parent: str
    child: str
    xyz_m: tuple[float, float, float]
    rpy_deg: tuple[float, float, float]


Calibrated = tuple[tuple[CameraGlance, ...], tuple[LinkGlance, ...], tuple[str, ...]]


def calibration_of(recording: KittiRecording) -> Calibrated:
    """Return the cameras and static transforms of a recording, and notes on missing parts."""
    first = min(int(index.numbers[0]) for index in recording.streams.values())
    calibration = recording.calibration(first)
    rig = make_rig(recording, MessageOptions())
    cameras = []
    for index, camera in sorted(calibration.cameras.items()):
        frame = rig.frames.camera(image_frame_camera(calibration, index))
        info = encode_camera_info(calibration, index, camera.size or (0, 0), 0, frame)
        cameras.append(_camera_glance(f'camera_{rig.frames.cameras.get(index, index)}', info))
    mounted = with_nominal_mounts(calibration, rig.cameras)
    links = static_links(mounted, rig.base_t_imu, rig.frames)
    notes = tuple(
        reason for part, reason in calibration.missing.items() if not part.startswith('P')
    )
    nominal = tuple(f'{part} is nominal, not in the calibration' for part in mounted.nominal)
    return tuple(cameras), _link_glances(links), notes + calibration.notes + nominal


def bag_calibration(bag: OpenBag, summary: BagSummary) -> Calibrated:
    """Return the cameras and static transforms in the first messages of a bag."""
    infos = {topic.name for topic in summary.topics if topic.msgtype == CAMERA_INFO and topic.count}
    statics = {
        topic.name: min(topic.count, _MOST_TF)
        for topic in summary.topics
        if topic.msgtype == TF and topic.name.endswith('tf_static')
    }
    cameras: dict[str, CameraGlance] = {}
    links: dict[str, tuple[str, str, Transform]] = {}
    due = sum(statics.values())
    if not infos and not due:
        return (), (), ()
    try:
        with open_messages(bag, infos | set(statics)) as messages:
            for message in messages:
                if message.topic in statics and due:
                    due -= 1
                    decoded = decode_static(deserialize(message.data, message.msgtype))
                    links |= {child: (parent, child, place) for parent, child, place in decoded}
                elif message.topic not in cameras:
                    info = deserialize(message.data, message.msgtype)
                    cameras[message.topic] = _camera_glance(message.topic, info)
                if not due and len(cameras) == len(infos):
                    break
    except KittiRos2Error as error:
        return (), (), (f'calibration not shown: {error}',)
    except Exception as error:  # noqa: BLE001 - a recorder may have written any bytes
        return (), (), (f'calibration not shown, its messages do not decode: {error}',)
    return tuple(cameras[name] for name in sorted(cameras)), _link_glances(links.values()), ()


def _camera_glance(name: str, info: CameraInfo) -> CameraGlance:
    k, p = info.k.reshape(3, 3), info.p.reshape(3, 4)
    focal = float(p[0, 0]) or float(k[0, 0])
    values = (k[0, 0], k[1, 1], k[0, 2], k[1, 2], -p[0, 3] / focal if focal else np.nan)
    # Drivers of uncalibrated cameras fill in zeros.
    known = bool(k[0, 0]) and bool(k[1, 1])
    fx, fy, cx, cy, baseline = (_finite(float(value)) if known else None for value in values)
    return CameraGlance(name, info.width or None, info.height or None, fx, fy, cx, cy, baseline)


def _finite(value: float) -> float | None:
    """Return the value without negative zero; None if it is not finite."""
    return value + 0.0 if np.isfinite(value) else None


def _link_glances(links: Iterable[tuple[str, str, Transform]]) -> tuple[LinkGlance, ...]:
    return tuple(
        LinkGlance(
            parent,
            child,
            _rounded(transform.translation.tolist()),
            _rounded([np.degrees(angle) for angle in rotation_to_rpy(transform.rotation)]),
        )
        for parent, child, transform in links
    )


def _rounded(values: Sequence[float]) -> tuple[float, float, float]:
    """Round to a micrometre or a millionth of a degree, without negative zeros."""
    x, y, z = (round(float(value), 6) + 0.0 for value in values)
    return x, y, z
