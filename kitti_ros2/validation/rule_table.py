# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""All rules, in the order of the documentation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .bag_rules import BAG_RULES
from .calib_rules import CALIBRATION_RULES
from .file_rules import FILE_RULES
from .frame_rules import FRAME_RULES
from .image_rules import IMAGE_RULES
from .label_rules import LABEL_RULES
from .message_rules import MESSAGE_RULES
from .motion_rules import OXTS_RULES, POSE_RULES
from .recording_rules import RECORDING_RULES
from .scan_rules import SCAN_RULES
from .set_rules import SET_RULES
from .source_rules import SOURCE_RULES
from .stamp_rules import STAMP_RULES
from .topic_rules import TOPIC_RULES
from .tracklet_rules import TRACKLET_RULES

if TYPE_CHECKING:
    from .rule import Rule

FOLDER_RULES: tuple[Rule[Any], ...] = (
    *FILE_RULES,
    *SCAN_RULES,
    *IMAGE_RULES,
    *CALIBRATION_RULES,
    *LABEL_RULES,
    *TRACKLET_RULES,
    *FRAME_RULES,
    *STAMP_RULES,
    *OXTS_RULES,
    *POSE_RULES,
    *RECORDING_RULES,
    *SET_RULES,
)
"""Rules about KITTI folders."""
ALL_BAG_RULES: tuple[Rule[Any], ...] = (*BAG_RULES, *TOPIC_RULES, *MESSAGE_RULES)
"""Rules about bags."""
RULES: dict[str, Rule[Any]] = {
    each.id: each for each in (*SOURCE_RULES, *FOLDER_RULES, *ALL_BAG_RULES)
}
"""All rules, by id."""
