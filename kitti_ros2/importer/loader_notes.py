# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What programs that load, train on or evaluate KITTI demand of labels, beyond its format.

mmdetection3d and OpenPCDet compute the yaw of a box in the scan as -(pi/2 + rotation_y), as if x of
the scan were the optical axis of the camera (mmdetection3d v1.4.0,
mmdet3d/structures/ops/box_np_ops.py:66; OpenPCDet, pcdet/datasets/kitti/kitti_dataset.py:167-168).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..kitti.names import SPLITS
from ..messages.source import LABEL_LINES
from ..model.errors import KittiRos2Error
from ..rig.heading import describe_direction
from .calibration_source import camera_models
from .camera_sets import plans_of
from .label_classes import is_own
from .optical_frames import made_optical_frames
from .plan import TF
from .rig_cameras import other_cameras
from .scan_frame import CAMERA, LEVEL, made_frame, optical_axis

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..model.geometry import Float64Array
    from .plan import Plan
    from .survey import Survey

_TURN_RAD = np.radians(5)
"""KITTI's own scans are turned by less than a degree."""


def loader_notes(plan: Plan, survey: Survey) -> Iterator[str]:
    """Yield notes on pitfalls in loading, training on or evaluating the labels."""
    is_set = plan.layout.traits.frame_set
    if plan.labels is None:
        if is_set and plan.name == SPLITS[0]:
            yield 'loaders read label_2 of training frames; without labels say --name testing'
        return
    if is_set:
        yield from _turned_scans(plan, survey)
    tracked = survey.tracklets and is_own(survey, plan.labels.topic)
    if not (plan.layout.traits.tracklets or plan.labels.topic == LABEL_LINES or tracked):
        yield (
            f'{plan.labels.topic}: has no occlusion, so labels contain 0, visible, and evaluations'
            f' count them; labels.occluded of the plan: 3 is unknown, which they leave out'
        )


def _turned_scans(plan: Plan, survey: Survey) -> Iterator[str]:
    """Yield a note on the cameras that look aside from x of the scans."""
    if plan.scan is None or plan.calibration != TF:
        return
    turned = {}
    for name, one in plans_of(plan).items():
        axis = _camera_in_scan(one, survey)
        # One that looks up or down has no direction there; its frame may be no optical one.
        if axis is None or np.hypot(axis[0], axis[1]) < LEVEL:
            continue
        if abs(np.arctan2(axis[1], axis[0])) > _TURN_RAD:
            turned[name] = describe_direction(axis)
    if not turned:
        return
    each = ', '.join(f'{name} ({looks})' for name, looks in turned.items())
    if plan.camera_sets:
        what, also = f'cameras of the sets look aside from x of the scans: {each}', ' of each set'
    else:
        what, also = f'camera 2 looks {next(iter(turned.values()))} in the scans', ''
    yield (
        f'{what}, so mmdetection3d and OpenPCDet turn boxes by that angle: to train with them set'
        f' scan.forward: {CAMERA} in the plan, which turns the scans{also}'
    )


def _camera_in_scan(plan: Plan, survey: Survey) -> Float64Array | None:
    """Return (3,) the direction of camera 2 in the scans as written, None if it is not known."""
    try:
        models = camera_models(plan, survey)
        if not models:
            return None
        others, links = other_cameras(plan, survey)
        optical = [*links, *made_optical_frames(plan, survey)]
        plan, made = made_frame(plan, survey.tree_with(optical), models, others)
        tree = survey.tree_with([*optical, *made])
        return None if plan.scan is None else optical_axis(tree, plan.scan.frame, models, others)
    except KittiRos2Error:  # it stops the conversion, which reports it
        return None
