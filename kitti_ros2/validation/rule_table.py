# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""All rules, in the order of the documentation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .calib_rules import CALIBRATION_RULES
from .file_rules import FILE_RULES
from .frame_rules import FRAME_RULES, LABEL_FRAME_RULES, SCAN_FRAME_RULES
from .image_rules import IMAGE_RULES
from .label_rules import LABEL_RULES
from .motion_rules import OXTS_RULES, POSE_RULES
from .recording_rules import RECORDING_RULES
from .scan_rules import SCAN_RULES
from .set_rules import SET_RULES
from .source_rules import SOURCE_RULES
from .stamp_rules import STAMP_RULES
from .tracklet_rules import TRACKLET_RULES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .rule import Rule

FOLDER_RULES: tuple[Rule[Any], ...] = (
    *SOURCE_RULES,
    *FILE_RULES,
    *SCAN_RULES,
    *IMAGE_RULES,
    *CALIBRATION_RULES,
    *LABEL_RULES,
    *TRACKLET_RULES,
    *LABEL_FRAME_RULES,
    *SCAN_FRAME_RULES,
    *FRAME_RULES,
    *STAMP_RULES,
    *OXTS_RULES,
    *POSE_RULES,
    *RECORDING_RULES,
    *SET_RULES,
)
"""Rules about KITTI folders, and about what is given."""


def rules_by_id(*, bags: bool) -> dict[str, Rule[Any]]:
    """Return the rules by id; those about bags only if they are needed: messages take 0.1 s."""
    rules: Sequence[Rule[Any]] = FOLDER_RULES
    if bags:
        from .bag_rules import BAG_RULES  # noqa: PLC0415 - see above
        from .message_rules import MESSAGE_RULES  # noqa: PLC0415
        from .topic_rules import TOPIC_RULES  # noqa: PLC0415

        rules = (*FOLDER_RULES, *BAG_RULES, *TOPIC_RULES, *MESSAGE_RULES)
    return {each.id: each for each in rules}
