# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The containers: each is complete and distinct."""

import pytest

from kitti_ros2.model.bag_formats import CONTAINERS, container_of


def test_containers_differ_in_their_suffix_and_their_first_bytes():
    for value in ('suffix', 'magic', 'title'):
        assert len({getattr(each, value) for each in CONTAINERS.values()}) == len(CONTAINERS)


@pytest.mark.parametrize('container', CONTAINERS.values(), ids=CONTAINERS)
def test_a_container_can_be_written_without_compression(container):
    assert 'none' in container.compressions
    assert any(glob == f'*{container.suffix}' for glob in container.globs)


@pytest.mark.parametrize(
    ('suffix', 'name'), [('.mcap', 'mcap'), ('.bag', 'ros1'), ('.db3', None), ('', None)]
)
def test_a_suffix_names_the_container_of_single_files(suffix, name):
    assert container_of(suffix) == name
