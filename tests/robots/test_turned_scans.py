# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""scan.forward: camera turns the scans to the camera, as programs that train on KITTI take them."""

from __future__ import annotations

from dataclasses import replace

import camera_rigs
import numpy as np
import pytest
import small_rigs
from camera_rigs import inside, moved, pose, read_frame, turned, world
from object_readers import axes_of, check_openpcdet, points_in_labels
from test_surround_rigs import convert  # noqa: F401 - a fixture

from kitti_ros2.cli import main

SIDES = {'front': 0, 'left': 1, 'rear': 2, 'right': 3}
"""By camera the box that it sees."""


def robot(*names: str, turn: float = 18.0, tilt: np.ndarray | None = None) -> camera_rigs.Robot:
    """Cameras at the sides, and a scanner that is turned, and tilted by a rotation."""
    base = small_rigs.sides(*names)
    rotation = turned(turn) if tilt is None else turned(turn) @ tilt
    base_T_lidar = pose(rotation, (0.3, 0.0, 1.2))
    links = (('base_link', 'lidar', base_T_lidar), *base.links[1:])
    return replace(base, links=links, base_T_lidar=base_T_lidar)


@pytest.fixture
def written(tmp_path, capsys):
    """Convert with scan.forward: VALUE; return the output, and what was printed."""

    def run(made, *words, forward='camera', code=0, change=('', '')):
        bag = camera_rigs.write(made, tmp_path / 'bag')
        assert main(['to-kitti', str(bag), '--layout', 'object', *words, '--plan']) == 0
        text = capsys.readouterr().out
        lines = [line for line in text.splitlines() if not line.startswith('  forward:')]
        text = '\n'.join(lines).replace('scan:\n', f'scan:\n  forward: {forward}\n')
        path = tmp_path / 'plan.yaml'
        path.write_text(text.replace(*change))
        call = ['to-kitti', str(bag), str(tmp_path / 'out'), '--plan-file', str(path)]
        assert main(call) == code
        return tmp_path / 'out', capsys.readouterr()

    return run


def assert_trains(split, camera, box):
    """A set is as OpenPCDet and mmdetection3d take it, and true."""
    frame = read_frame(split, 1)
    rect_r_velo = frame.calib['R0_rect'] @ frame.calib['Tr_velo_to_cam'][:, :3]
    np.testing.assert_allclose(axes_of(rect_r_velo), 0, atol=0.05)
    seen = np.isfinite(camera.pixels(world())[:, 0])
    rect = moved(frame.calib['Tr_velo_to_cam'], frame.points) @ frame.calib['R0_rect'].T
    pixels = moved(frame.calib['P2'], rect[seen])
    pixels = pixels[:, :2] / pixels[:, 2:]
    assert np.abs(pixels - camera.pixels(world())[seen]).max() < 0.3
    root = split.parent / f'only_{split.name}'
    root.mkdir()
    (root / 'training').symlink_to(split)
    (root / 'ImageSets').symlink_to(split.parent / 'ImageSets')
    true = int(inside(world(), camera_rigs.boxes()[box]).sum())
    assert list(points_in_labels(root).values()) == [[true]] * camera_rigs.FRAMES
    assert check_openpcdet(root) == []


@pytest.mark.parametrize('turn', [18.0, -100.0])
def test_the_scans_of_a_set_look_where_camera_2_looks(written, turn):
    made = robot('front', turn=turn)
    out, _ = written(made)
    assert_trains(out / 'training', made.cameras[0], 0)


def test_each_camera_s_set_has_scans_of_its_own(written):
    made = robot(*SIDES)
    out, _ = written(made, '--all-cameras')
    for name, camera in zip(SIDES, made.cameras, strict=True):
        assert_trains(out / f'training_{name}', camera, SIDES[name])


def test_a_scanner_whose_z_is_not_up_gets_the_body_s_vertical(written):
    made = robot('front', turn=18.0, tilt=turned(0.0, 60.0))
    out, _ = written(made)
    assert_trains(out / 'training', made.cameras[0], 0)


def test_without_it_a_note_tells_the_angle_and_the_key(convert):  # noqa: F811
    made = robot('front')
    plan, notes, split = convert(made)
    assert plan.scan.forward == ''
    note = next(line for line in notes.splitlines() if 'scan.forward: camera' in line)
    assert '18 degrees to the right' in note
    assert len(read_frame(split, 0).points) == len(world())


def test_a_note_tells_the_angle_of_each_set(convert):  # noqa: F811
    plan, notes, _ = convert(robot(*SIDES, turn=3.0), '--all-cameras')
    assert plan.scan.forward == ''
    (note,) = (line for line in notes.splitlines() if 'scan.forward: camera' in line)
    assert 'left (87 degrees to the left), rear (backward)' in note
    assert 'front' not in note


def test_small_angles_and_sets_without_labels_have_no_note(convert):  # noqa: F811
    _, notes, _ = convert(robot('front', turn=3.0))
    assert 'scan.forward: camera' not in notes


def test_sets_without_boxes_have_no_note(convert):  # noqa: F811
    _, notes, _ = convert(replace(robot('front'), with_boxes=False))
    assert 'scan.forward: camera' not in notes


def test_a_given_calibration_is_for_the_scans_as_they_are(written):
    change = ('calibration: tf', 'calibration: none')
    _, said = written(replace(robot('front'), with_boxes=False), code=2, change=change)
    assert 'scan: forward: camera; expected calibration: tf and a camera' in said.err
    assert said.err.count('\n') == 1


def test_a_camera_that_looks_down_is_no_direction(written):
    base = robot('front')
    down = camera_rigs.looking(0.0, (0.5, 0.0, 3.0), 88.0)
    camera = replace(base.cameras[0], base_T_camera=down)
    links = tuple((a, b, down if b == camera.frame else place) for a, b, place in base.links)
    made = replace(base, cameras=(camera,), links=links, with_boxes=False)
    _, said = written(made, code=2)
    assert 'scan: forward: camera; the camera looks' in said.err
    assert said.err.count('\n') == 1
