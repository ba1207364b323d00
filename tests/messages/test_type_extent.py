# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Definitions of a few lines that hold more fields than code can visit."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from kitti_ros2.messages.type_definitions import check_extent

RULE = '\n' + '=' * 80 + '\n'


def fielddefs(text):
    return get_types_from_msg(text, 'p/msg/Top')


def doubled(levels, fields='T{0} a\nT{0} b\n'):
    parts = [f'MSG: p/T{n}\n{fields.format(n + 1)}' for n in range(levels)]
    return RULE.join([fields.format(0), *parts, f'MSG: p/T{levels}\n'])


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        (doubled(60), 'holds more than 1000000 fields'),
        (doubled(20, 'T{0}[100] a\n'), 'holds more than 1000000 fields'),
        (doubled(300, 'T{0} a\n'), 'too deeply'),
        ('p/Top a\n', 'hold themselves'),
        ('p/Top[] a\n', 'hold themselves'),
    ],
)
def test_what_code_cannot_visit_is_refused(text, said):
    with pytest.raises(ValueError, match=said):
        check_extent('p/msg/Top', fielddefs(text))


def test_types_in_use_pass():
    known = get_typestore(Stores.ROS2_JAZZY).fielddefs
    for msgtype in known:
        check_extent(msgtype, known)
    check_extent('p/msg/Top', fielddefs(doubled(15)))
    check_extent('not/msg/Defined', known)
