# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Occlusion and truncation of a raw drive's tracklets, in the labels of other layouts."""

from __future__ import annotations

import shutil
from dataclasses import replace

import pytest

import kitti_ros2
from kitti_ros2 import read_tracklets, write_tracklets
from kitti_ros2.cli import main
from kitti_ros2.kitti import label_file
from kitti_ros2.model.streams import Layout

OCCLUSIONS = (0, 1, 2, -1)
TRUNCATIONS = (0, 1, 2, 99, -1)
LEVELS = {0: 0.0, 1: 1.0, 2: 2.0, 99: 2.0}


@pytest.fixture(scope='module')
def drive(recordings, tmp_path_factory):
    """A drive whose tracklets have another occlusion and truncation in each frame."""
    source = recordings[Layout.RAW]
    root = tmp_path_factory.mktemp('raw') / source.parent.name
    shutil.copytree(source.parent, root)
    (path,) = root.rglob('tracklet_labels.xml')
    tracklets = [
        replace(
            each,
            poses=[
                replace(
                    pose,
                    occlusion=OCCLUSIONS[(track + each.first_frame + place) % len(OCCLUSIONS)],
                    truncation=TRUNCATIONS[(track + place) % len(TRUNCATIONS)],
                )
                for place, pose in enumerate(each.poses)
            ],
        )
        for track, each in enumerate(read_tracklets(path))
    ]
    write_tracklets(path, tracklets)
    return path


def poses_of(path):
    """By frame and track the pose of the tracklet."""
    return {
        (each.first_frame + place, track): pose
        for track, each in enumerate(read_tracklets(path))
        for place, pose in enumerate(each.poses)
    }


def convert(drive, out, layout, words=(), plan=()):
    bag = out / 'drive.mcap'
    assert main(['to-bag', str(drive.parent), str(bag), '-q', *words]) == 0
    assert main(['to-kitti', str(bag), str(out / 'set'), '--layout', layout, *plan]) == 0
    return out / 'set'


_ALL = ('detections', 'markers', 'tracked_objects', 'detected_objects')


@pytest.mark.parametrize('words', [(), ('--ring-time',), ('--start', '2')])
def test_tracking_labels_have_occlusion_and_level(words, drive, tmp_path, capsys):
    made = convert(drive, tmp_path, 'tracking', words)
    said = capsys.readouterr().out
    poses = poses_of(drive)
    shift = 2 if '--start' in words else 0
    lines = (made / 'training/label_02/0000.txt').read_text().splitlines()
    seen = set()
    for box in map(label_file.parse_box, lines):
        pose = poses[box.frame + shift, box.track_id]
        assert box.occluded == max(pose.occlusion, 0)
        if pose.truncation in LEVELS:
            assert box.truncated == LEVELS[pose.truncation]
        seen.add(pose.occlusion)
    assert seen == {*OCCLUSIONS}
    fully = sum(line.split()[4] == '2' for line in lines)
    assert f'{fully} boxes are fully occluded in the tracklets' in said
    assert 'boxes have no occlusion in the tracklets; labels contain 0' in said
    assert 'has no occlusion' not in said


@pytest.mark.parametrize('topic', _ALL)
def test_object_labels_have_the_occlusion_by_every_topic(topic, drive, tmp_path):
    others = [f'/kitti/labels/{each}' for each in _ALL if each != topic]
    made = convert(drive, tmp_path, 'object', ('--objects', 'both', '--exclude-topics', *others))
    counts = dict.fromkeys(OCCLUSIONS[:3], 0)
    parts = 0
    for path in (made / 'training/label_2').iterdir():
        for box in map(label_file.parse_box, path.read_text().splitlines()):
            counts[box.occluded] += 1
            assert 0 <= box.truncated <= 1
            parts += 0 < box.truncated < 1
    assert all(counts.values())
    assert parts  # the part outside of the image, not a level


def test_another_drive_keeps_its_tracklets(drive, tmp_path, capsys):
    bag, plan = tmp_path / 'drive.mcap', tmp_path / 'plan.yaml'
    assert main(['to-bag', str(drive.parent), str(bag), '-q']) == 0
    capsys.readouterr()
    assert main(['to-kitti', str(bag), '--layout', 'raw', '--plan']) == 0
    plan.write_text(capsys.readouterr().out)
    made = tmp_path / 'made'
    assert main(['to-kitti', str(bag), str(made), '--plan-file', str(plan), '-q']) == 0
    (path,) = made.rglob('tracklet_labels.xml')
    before = sorted(pose.occlusion for pose in poses_of(drive).values())
    after = sorted(pose.occlusion for pose in poses_of(path).values())
    assert len({*after}) > 2
    assert after.count(2) == before.count(2)


def test_objects_of_a_drive_have_the_occlusion(drive):
    poses = poses_of(drive)
    recording = kitti_ros2.open(drive.parent)
    found = [
        (each.occluded, poses[frame.number, each.track].occlusion)
        for frame in recording
        for each in frame.objects
    ]
    assert {occluded for occluded, _ in found} == {0, 1, 2, None}
    assert all(occluded == (None if own < 0 else own) for occluded, own in found)
