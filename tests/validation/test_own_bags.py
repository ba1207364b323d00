# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Every sound bag that to-bag writes is valid, whatever its layout, container and options."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import pytest

from kitti_ros2.cli import main
from kitti_ros2.datasets import validate
from kitti_ros2.model.bag_formats import CONTAINERS, FORMATS
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.stack_names import StackName

from cropped_set import crop_frame  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

OPTIONS = (
    *(('--storage', name) for name in CONTAINERS),
    *(('--points', name.value) for name in FORMATS),
    *(('--for', stack.value) for stack in StackName),
    ('--preset', 'kitti2bag', '--images', 'both', '--map', 'devkit'),
    ('--objects', 'both', '--annotations', '--covariances', '--trails'),
    ('--stereo', '--ground-truth-tree'),
    ('--stereo', '--stereo-frame', 'left', '--no-tf'),
    ('--exclude-topics', '/kitti/source/*'),
)
"""Of to-bag."""


@pytest.fixture(scope='module')
def sources(recordings: Mapping[Layout, Path], tmp_path_factory) -> Mapping[Layout, Path]:
    """The recordings; images of the object set have two sizes, each with its calibration."""
    root = tmp_path_factory.mktemp('days') / 'set'
    shutil.copytree(recordings[Layout.OBJECT], root)
    crop_frame(root, 1)
    return {**recordings, Layout.OBJECT: root}


@pytest.mark.one_in(3)
@pytest.mark.parametrize('words', OPTIONS, ids=' '.join)
@pytest.mark.parametrize('layout', list(Layout), ids=lambda layout: layout.value)
def test_a_sound_bag_has_no_error(sources, tmp_path, capsys, layout, words):
    bag = tmp_path / 'bag'
    code = main(['to-bag', str(sources[layout]), str(bag), '--end', '2', *words])
    said = capsys.readouterr()
    if 'no annotations can be made' in said.err:
        assert layout is Layout.ODOMETRY
        return
    assert code in {0, 1}, said.err  # 1: a stack's demand that the layout cannot meet
    found = validate([*tmp_path.iterdir()])
    assert sum(each.count for each in found.sources) > 0
    whole = '--exclude-topics' not in words
    assert [each for each in found.findings if whole or each.rule != 'tf-changing'] == []
    assert found.errors == 0
