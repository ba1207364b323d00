# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""All targets, by name."""

from __future__ import annotations

from . import (
    archive_targets,
    bag_folder_targets,
    bag_targets,
    compact_targets,
    definition_targets,
    foxglove_targets,
    kitti_targets,
    message_targets,
    option_targets,
    own_bag_targets,
    picture_targets,
    plan_targets,
    result_targets,
    yaml_targets,
)

_ALL = (
    *kitti_targets.TARGETS,
    *picture_targets.TARGETS,
    *archive_targets.TARGETS,
    *yaml_targets.TARGETS,
    *bag_targets.TARGETS,
    *bag_folder_targets.TARGETS,
    *own_bag_targets.TARGETS,
    *compact_targets.TARGETS,
    *plan_targets.TARGETS,
    *definition_targets.TARGETS,
    *message_targets.TARGETS,
    *option_targets.TARGETS,
    *foxglove_targets.TARGETS,
    *result_targets.TARGETS,
)
TARGETS = {target.name: target for target in _ALL}
