# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Coordinates that can hardly be metres are asked about, and scaled by the plan."""

from __future__ import annotations

import clocks_apart as base
import numpy as np
import pytest

from kitti_ros2.cli import main
from kitti_ros2.importer.plan import parse_plan
from kitti_ros2.model.errors import UsageError

WHOLE = 'x y z are whole numbers ({})'
FAR = 'half of the points are more than {} m away'


def points_of(kind: str, scale: float) -> np.ndarray:
    """A ring of 60 points 8 m away; one point is at 0 0 0."""
    made = np.zeros(61, [(name, kind) for name in 'xyz'] + [('intensity', '<f4')])
    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    made['x'][1:] = np.rint(8 * scale * np.cos(angles))
    made['y'][1:] = np.rint(8 * scale * np.sin(angles))
    return made


@pytest.mark.parametrize(
    ('kind', 'scale', 'frame', 'asked'),
    [
        ('<i4', 1000, 'lidar', WHOLE.format('int32')),
        ('<i2', 1000, 'lidar', WHOLE.format('int16')),
        ('<f4', 1000, 'lidar', FAR.format(8000)),
        ('<f8', 1000, 'lidar', FAR.format(8000)),
        ('<f4', 10, 'lidar', ''),
        ('<f4', 1000, 'map', ''),
    ],
)
def test_they_are_asked_about_and_not_changed(kind, scale, frame, asked, tmp_path, capsys):
    bag = base.write_clouds(tmp_path / 'bag', lambda _: points_of(kind, scale), frame)
    assert main(['to-kitti', str(bag), '--layout', 'object', '--plan']) == 0
    said = capsys.readouterr()
    question = 'are they millimetres? scan.unit_m: 0.001 of the plan makes metres of them'
    assert (f'/points: {asked}; {question}' in said.out + said.err) is bool(asked)
    assert ('are they millimetres' in said.out + said.err) is bool(asked)


@pytest.mark.parametrize('kind', ['<i4', '<f4'])
def test_the_plan_scales_them(kind, tmp_path, capsys):
    bag = base.write_clouds(tmp_path / 'bag', lambda _: points_of(kind, 1000))
    main(['to-kitti', str(bag), '--layout', 'object', '--plan'])
    plan = tmp_path / 'plan.yaml'
    text = capsys.readouterr().out
    for unit, radius in (('', 8000), ('\n  unit_m: 0.001', 8)):
        plan.write_text(text.replace('topic: /points', f'topic: /points{unit}'))
        out = tmp_path / f'out{radius}'
        assert main(['to-kitti', str(bag), str(out), '--plan-file', str(plan)]) == 0
        points = np.fromfile(out / 'training/velodyne/000003.bin', '<f4').reshape(-1, 4)
        np.testing.assert_allclose(np.linalg.norm(points[:, :3], axis=1), radius, rtol=1e-3)
        said = capsys.readouterr()
        assert ('are they millimetres' in said.out + said.err) is (not unit)


@pytest.mark.parametrize('value', ['0', '-0.001'])
def test_a_unit_that_cannot_be_meant_is_refused(value, tmp_path):
    text = (
        'layout: object\nname: training\nreference: scan\ntolerance_s: 0.05\n'
        f'scan: {{topic: /points, frame: lidar, unit_m: {value}}}\n'
    )
    with pytest.raises(UsageError, match=r'scan: unit_m: .*; expected more than 0'):
        parse_plan(text, tmp_path / 'plan.yaml')
