# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pages read in parts: the same bytes as a plain read and a copy."""

from __future__ import annotations

import ctypes
import errno
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kitti_ros2.bags import container_file
from kitti_ros2.bags.container_file import PageScatter

PAGES = 40
PREADV = container_file._preadv


@pytest.fixture(params=['preadv', 'pread'], autouse=True)
def way(request):
    with pytest.MonkeyPatch.context() as patch:
        if request.param == 'pread':
            patch.setattr(container_file, '_preadv', lambda: None)
        yield


@pytest.fixture(scope='module')
def pages(tmp_path_factory):
    path = tmp_path_factory.mktemp('pages') / 'file'
    path.write_bytes(np.random.default_rng(3).bytes(PAGES * 512))
    file = os.open(path, os.O_RDONLY)
    yield file, np.fromfile(path, np.uint8).reshape(PAGES, 512)
    os.close(file)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_heads_and_bodies_go_to_their_places(pages, data):
    file, expected = pages
    body = data.draw(st.sampled_from([508, 507, 500, 12]))
    scatter = PageScatter(512, body, data.draw(st.sampled_from([512, 4096, 2**20])))
    first = data.draw(st.integers(0, PAGES - 1))
    count = data.draw(st.integers(1, min(scatter.most, PAGES - first)))
    last = data.draw(st.integers(1, body))
    around = np.full((count - 1) * body + last + 64, 7, np.uint8)
    heads = scatter.read(file, first * 512, count, around[32:-32])
    chosen = expected[first : first + count]
    assert heads.tolist() == chosen[:, :4].copy().view('>u4')[:, 0].tolist()
    assert (around[32:-32] == chosen[:, 4 : 4 + body].ravel()[: len(around) - 64]).all()
    assert (around[:32] == 7).all()
    assert (around[-32:] == 7).all()


def test_beyond_the_end_of_the_file(pages):
    file, _ = pages
    scatter = PageScatter(512, 508, 2**20)
    assert scatter.read(file, (PAGES - 1) * 512, 2, np.zeros(600, np.uint8)) is None
    assert scatter.read(file, PAGES * 512, 1, np.zeros(508, np.uint8)) is None
    assert scatter.read(file, (PAGES - 1) * 512, 1, np.zeros(508, np.uint8)) is not None


@pytest.mark.parametrize(
    ('count', 'size'), [(0, 508), (1, 509), (1, 0), (3, 2 * 508), (8, 9 * 508)]
)
def test_a_target_of_another_size_is_refused(pages, count, size):
    with pytest.raises(ValueError, match='do not fit'):
        PageScatter(512, 508, 4096).read(pages[0], 0, count, np.zeros(size, np.uint8))


def test_a_target_that_cannot_be_written_is_refused(pages):
    target = np.zeros((508, 2), np.uint8)[:, 0]
    with pytest.raises((TypeError, ValueError, BufferError)):
        PageScatter(512, 508, 4096).read(pages[0], 0, 1, target)
    target = np.zeros(508, np.uint8)
    target.flags.writeable = False
    with pytest.raises(TypeError):
        PageScatter(512, 508, 4096).read(pages[0], 0, 1, target)


def test_an_error_of_the_system_is_raised(tmp_path):
    file = os.open(tmp_path, os.O_RDONLY)
    with pytest.raises(IsADirectoryError):
        PageScatter(512, 508, 4096).read(file, 0, 1, np.zeros(508, np.uint8))
    os.close(file)


def test_an_interrupted_read_is_repeated(pages, monkeypatch):
    file, expected = pages
    read, interrupted = PREADV(), []

    def interrupt(*given):
        if len(interrupted) < 2:
            interrupted.append(given)
            ctypes.set_errno(errno.EINTR)
            return -1
        return read(*given)

    monkeypatch.setattr(container_file, '_preadv', lambda: interrupt)
    target = np.zeros(508, np.uint8)
    assert PageScatter(512, 508, 4096).read(file, 512, 1, target) is not None
    assert (target == expected[1, 4:]).all()
    assert len(interrupted) == 2
