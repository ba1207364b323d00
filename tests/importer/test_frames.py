# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which frames a plan makes of stamps alone."""

from __future__ import annotations

import numpy as np
import pytest

from kitti_ros2.importer.kitti_frames import choose_frames
from kitti_ros2.importer.plan import CameraPlan, Incomplete, LabelPlan, Plan, PosePlan, ScanPlan
from kitti_ros2.importer.survey import Survey, TopicSurvey
from kitti_ros2.messages.moving_tree import PoseTrack
from kitti_ros2.model import bag_formats as types
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.streams import Layout, Stream

MS = 1_000_000


def survey(**milliseconds):
    """Topics /name with header stamps, and log times 5 ms later."""
    kinds = {'scan': types.CLOUD, 'left': types.IMAGE, 'boxes': types.DETECTIONS_3D}
    topics = {}
    for name, stamps in milliseconds.items():
        header = [stamp * MS for stamp in stamps]
        log = [stamp * MS + 5 * MS for stamp in stamps]
        topics[f'/{name}'] = TopicSurvey(f'/{name}', kinds[name], log, header)
    return Survey(topics, [], [])


def track(*milliseconds):
    stamps = np.array(milliseconds) * MS
    return PoseTrack(stamps, [Transform.identity()] * len(stamps))


def plan(**changes):
    values = {
        'layout': Layout.OBJECT,
        'name': 'training',
        'reference': 'scan',
        'tolerance_s': 0.05,
        'scan': ScanPlan('/scan', 'lidar'),
        'cameras': {2: CameraPlan('/left')},
    }
    return Plan(**{**values, **changes})


def test_frames_that_lack_a_sample_are_dropped_and_told():
    frames = choose_frames(plan(), survey(scan=[1000, 1100, 1200], left=[1001, 1199, 1230]), None)
    assert frames.stamps_ns.tolist() == [1000 * MS, 1200 * MS]
    assert frames.samples[Stream.SCAN].tolist() == [0, 2]
    assert frames.samples[Stream.IMAGE_2].tolist() == [0, 1]
    matching, dropping = frames.notes
    assert matching.startswith('image_2 (/left): 2 of 3 frames, off by 1.0 ms in the mean, 1.0 ms')
    assert matching.endswith('1 samples not used')
    assert dropping == 'dropped 1 of 3 frames: no image_2 within tolerance'


def test_frames_that_lack_a_sample_are_kept_where_the_plan_says_so():
    keeping = plan(incomplete=Incomplete.KEEP)
    frames = choose_frames(keeping, survey(scan=[1000, 1100, 1200], left=[1001, 1199]), None)
    assert frames.samples[Stream.IMAGE_2].tolist() == [0, -1, 1]


def test_labels_are_part_of_a_frame():
    labelled = plan(labels=LabelPlan('/boxes'))
    stamps = {'scan': [1000, 1100], 'left': [1000, 1100], 'boxes': [1100]}
    frames = choose_frames(labelled, survey(**stamps), None)
    assert frames.stamps_ns.tolist() == [1100 * MS]
    assert frames.samples[Stream.LABELS].tolist() == [0]


def test_no_frame_is_made_outside_of_the_poses():
    stamps = {'scan': [1000, 1100, 1200], 'left': [1000, 1100, 1200]}
    poses = track(1050, 1150)
    frames = choose_frames(plan(), survey(**stamps), poses)
    assert frames.stamps_ns.tolist() == [1100 * MS]
    where = f'1 before the first, at {1050 * MS}, 1 after the last, at {1150 * MS}'
    assert f'dropped 2 of 3 frames: no pose around them ({where})' in frames.notes
    assert frames.unposed_ns.tolist() == []


def test_poses_alone_are_frames_too():
    alone = plan(reference='pose', scan=None, cameras={}, pose=PosePlan('/odom', 'base_link'))
    frames = choose_frames(alone, survey(), track(1050, 1150))
    assert frames.stamps_ns.tolist() == [1050 * MS, 1150 * MS]


def test_no_frame_is_made_in_a_gap_of_the_poses():
    stamps = {'scan': [1000, 3000, 5000], 'left': [1000, 3000, 5000]}
    frames = choose_frames(plan(), survey(**stamps), track(900, 1100, 4900, 5100))
    assert frames.stamps_ns.tolist() == [1000 * MS, 5000 * MS]
    assert frames.unposed_ns.tolist() == [3000 * MS]
    where = '1 between poses too far apart'
    assert f'dropped 1 of 3 frames: no pose around them ({where})' in frames.notes


def test_stamps_of_0_give_way_to_log_time_and_that_is_told():
    frames = choose_frames(plan(), survey(scan=[1000, 1100], left=[0, 1100]), None)
    assert frames.stamps['/left'].tolist() == [5 * MS, 1105 * MS]
    assert any(note.startswith('/left: 1 of 2 header stamps is 0') for note in frames.notes)


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'scan': ScanPlan('/velo', 'lidar')}, 'the plan names /velo, of which the bag has no'),
        ({'reference': 'image_3'}, 'reference image_3; it must be one of'),
        ({'tolerance_s': 0.0001}, 'no frame is whole'),
    ],
)
def test_plans_that_give_nothing_are_wrong_usage(changes, said):
    with pytest.raises(UsageError) as caught:
        choose_frames(plan(**changes), survey(scan=[1000, 1100], left=[1001, 1101]), None)
    assert said in str(caught.value)
