# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels of points in clouds of any program become SemanticKITTI's, or are named as a loss."""

from __future__ import annotations

from typing import TYPE_CHECKING

import camera_rigs
import clocks_apart as base
import numpy as np
import pytest
import small_rigs
from rosbags.rosbag2 import Reader, Writer

from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.own_bags.to_kitti import propose_plan

if TYPE_CHECKING:
    from pathlib import Path

COUNT = 50
MISSING, NEAR = slice(3, 7), slice(20, 25)
"""Points that are no returns, and points on the robot."""


def points_of(number: int, *fields: tuple[str, str, object]) -> np.ndarray:
    """A scan with fields behind its points: name, type, and values by the scan's number."""
    made = np.zeros(COUNT, [*base.POINT[:4], *((name, kind) for name, kind, _ in fields)])
    angles = np.linspace(0, 2 * np.pi, COUNT, endpoint=False)
    made['x'], made['y'], made['z'] = 9 * np.cos(angles), 9 * np.sin(angles), 0.5
    for name in 'xyz':
        made[name][NEAR] /= 20
    made['x'][MISSING] = np.nan
    for name, _, values in fields:
        made[name] = values(number) if callable(values) else values
    return made


def classes(number: int) -> np.ndarray:
    return np.array([10, 40, 50, 252, 0])[(np.arange(COUNT) + number) % 5]


def instances(number: int) -> np.ndarray:
    return np.where(classes(number) == 10, number + 1, 0)


def packed(number: int) -> np.ndarray:
    return classes(number) | instances(number) << 16


def convert(bag: Path, out: Path, layout: str, *words: str) -> int:
    return main(['to-kitti', str(bag), str(out), '--layout', layout, *words])


def labels_of(out: Path) -> list[np.ndarray]:
    return [np.fromfile(each, '<u4') for each in sorted(out.rglob('labels/*.label'))]


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    'fields',
    [
        [('label', '<u2', classes), ('instance', '<u2', instances)],
        [('instance', '|u1', instances), ('label', '<i2', classes)],
        [('Label', '<f4', classes), ('Instance_ID', '<f8', instances)],
        [('ObjIdx', '<u4', instances), ('ObjTag', '<u4', classes)],
        [('semanticID', '<i4', classes), ('instanceID', '<i4', instances)],
        [('class_id', '<u2', classes), ('object_id', '<i4', instances)],
        [('label', '<u4', packed)],
        [('semantic_label', '<i4', packed)],
    ],
    ids=lambda fields: '-'.join(f'{name}{kind[1:]}' for name, kind, _ in fields),
)
def test_labels_are_written_in_step_with_their_points(fields, tmp_path, capsys):
    bag = base.write_clouds(tmp_path / 'bag', lambda number: points_of(number, *fields))
    out = tmp_path / 'out'
    assert convert(bag, out, 'odometry') == 0
    kept = np.delete(np.arange(COUNT), MISSING)
    found = labels_of(out)
    assert len(found) == base.FRAMES
    for number, labels in enumerate(found):
        assert labels.tolist() == packed(number)[kept].tolist()
        scan = np.fromfile(out / f'sequences/00/velodyne/{number:06d}.bin', '<f4').reshape(-1, 4)
        np.testing.assert_array_equal(scan[:, 0], points_of(number)['x'][kept])
    said = capsys.readouterr()
    assert 'become labels/*.label, as SemanticKITTI has them' in said.err + said.out
    assert 'SemanticKITTI does not have' not in said.err + said.out


@pytest.mark.parametrize('layout', ['raw', 'object', 'tracking'])
def test_layouts_without_files_for_them_name_the_loss(layout, tmp_path, capsys):
    bag = base.write_clouds(
        tmp_path / 'bag', lambda number: points_of(number, ('label', '|u1', classes))
    )
    assert convert(bag, tmp_path / 'out', layout) == 1
    assert not labels_of(tmp_path / 'out')
    said = capsys.readouterr()
    assert (
        f'skipped /points ({base.FRAMES}): /points: labels of points, for which layout odometry'
        ' alone has files'
    ) in said.out + said.err


def test_a_field_without_a_label_is_no_loss(tmp_path):
    bag = base.write_clouds(tmp_path / 'bag', lambda number: points_of(number, ('label', '<u4', 0)))
    assert convert(bag, tmp_path / 'out', 'object', '-q') == 0


def test_values_without_a_place_are_counted_and_classes_of_others_are_named(tmp_path, capsys):
    label = np.array([10, -1, 70000, 77, 5])[np.arange(COUNT) % 5]
    bag = base.write_clouds(
        tmp_path / 'bag',
        lambda number: points_of(number, ('label', '<i4', label), ('instance', '<i4', -1)),
    )
    out = tmp_path / 'out'
    assert convert(bag, out, 'odometry') == 1
    said = capsys.readouterr()
    wrong = 'values of label that are no whole numbers from 0 to 65535, written as 0'
    assert f'skipped /points ({10 * base.FRAMES}): /points: {wrong}' in said.out + said.err
    others = 'classes of points that SemanticKITTI does not have, written as they are: 5, 77'
    assert f'/points: {others}' in said.out + said.err
    expected = np.delete(np.where((label > 0) & (label < 70000), label, 0), MISSING)
    assert labels_of(out)[0].tolist() == expected.tolist()


def test_a_minimum_range_takes_points_and_labels(tmp_path, capsys):
    bag = base.write_clouds(
        tmp_path / 'bag', lambda number: points_of(number, ('label', '<u2', classes))
    )
    main(['to-kitti', str(bag), '--layout', 'odometry', '--plan'])
    plan = tmp_path / 'plan.yaml'
    text = capsys.readouterr().out
    plan.write_text(text.replace('topic: /points\n', 'topic: /points\n  minimum_range_m: 1\n'))
    out = tmp_path / 'out'
    assert main(['to-kitti', str(bag), str(out), '--plan-file', str(plan), '-q']) == 0
    kept = np.delete(np.arange(COUNT), [*range(3, 7), *range(20, 25)])
    assert labels_of(out)[4].tolist() == classes(4)[kept].tolist()


def test_every_camera_has_the_labels_of_the_scans(tmp_path):
    robot = small_rigs.sides('front', 'rear')
    plain = camera_rigs.write(robot, tmp_path / 'plain')
    bag = with_labels(plain, tmp_path / 'bag')
    out = tmp_path / 'out'
    assert convert(bag, out, 'odometry', '--all-cameras', '-q') == 0
    front, rear = (labels_of(out / name) for name in ('front', 'rear'))
    assert len(front) == camera_rigs.FRAMES
    assert [each.tolist() for each in front] == [each.tolist() for each in rear]
    assert set(front[0].tolist()) == {40, 50}


def with_labels(bag: Path, path: Path) -> Path:
    """The same bag, the points of its clouds with labels 40 and 50 in turn."""
    types = camera_rigs.store()
    with Reader(bag) as read, Writer(path, version=9) as written:
        channels = {
            each.topic: written.add_connection(each.topic, each.msgtype, typestore=types)
            for each in read.connections
        }
        for connection, stamp_ns, data in read.messages():
            if connection.msgtype.endswith('PointCloud2'):
                cloud = types.deserialize_cdr(data, connection.msgtype)
                points = np.zeros(cloud.width, [('xyzi', '<f4', 4), ('label', '<u2')])
                points['xyzi'] = cloud.data.view('<f4').reshape(-1, 4)
                points['label'] = np.where(np.arange(cloud.width) % 2, 40, 50)
                field = types.types['sensor_msgs/msg/PointField']
                cloud.fields.append(field(name='label', offset=16, datatype=4, count=1))
                cloud.point_step, cloud.row_step = 18, 18 * cloud.width
                cloud.data = points.view(np.uint8).ravel()
                data = types.serialize_cdr(cloud, connection.msgtype)  # noqa: PLW2901
            written.write(channels[connection.topic], stamp_ns, data)
    return path


def test_the_layout_that_has_files_for_them_is_preferred(tmp_path):
    bag = base.write_clouds(
        tmp_path / 'bag', lambda number: points_of(number, ('label', '<u2', classes))
    )
    with OpenBag(bag) as opened:
        proposal = propose_plan([opened], ImportOptions(), any_layout=True)
    assert proposal.plan.layout is Layout.ODOMETRY
    assert proposal.reason == 'the points have labels'


def test_clouds_without_the_labels_of_others_are_a_loss(tmp_path, capsys):
    """Loaders of SemanticKITTI pair the sorted files."""

    def make(number: int) -> np.ndarray:
        return points_of(number, *([('label', '<u2', classes)] if number % 2 else []))

    bag = base.write_clouds(tmp_path / 'bag', make)
    assert convert(bag, tmp_path / 'out', 'odometry') == 1
    assert 'no labels of points, which other clouds have' in capsys.readouterr().err


def test_semantickitti_s_own_names_go_before_others(tmp_path):
    fields = ('label', '<u2', classes), ('class_id', '<u2', 7), ('semantic', '<u2', 9)
    bag = base.write_clouds(tmp_path / 'bag', lambda number: points_of(number, *fields))
    assert convert(bag, tmp_path / 'out', 'odometry') == 0
    assert set(np.concatenate(labels_of(tmp_path / 'out')).tolist()) == {0, 10, 40, 50, 252}
