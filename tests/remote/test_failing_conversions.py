# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""to-bag and to-kitti from and to a server of which one request in twenty fails."""

from __future__ import annotations

import pytest

pytest.importorskip('s3fs', reason='s3:// needs s3fs')
pytest.importorskip('moto', reason='the S3 server of the tests is moto')

from kitti_ros2.cli import main
from kitti_ros2.files.remote import as_path
from kitti_ros2.files.remote_reads import forget
from kitti_ros2.model.streams import Layout

from builders import files_of  # isort: skip

RATE = 0.05
SEED = 20


def stored(s3, key, path):
    """Put a file or folder into the bucket, past all faults."""
    for each in [path] if path.is_file() else path.rglob('*'):
        if each.is_file():
            s3.put(f'{key}/{each.relative_to(path)}'.removesuffix('/.'), each.read_bytes())


def objects_below(s3, key):
    return {
        name.removeprefix(f'{key}/'): data
        for name, data in s3.objects().items()
        if name.startswith(f'{key}/')
    }


@pytest.fixture
def faults(s3, monkeypatch):
    """Return a function that lets requests fail, from now on; the pauses are not made."""
    monkeypatch.setattr('kitti_ros2.files.remote_requests.wait', lambda _: None)

    def begin():
        forget(as_path(s3.url))
        s3.server.clear()
        s3.server.fail_at_rate(RATE, SEED)

    return begin


def met(s3):
    return [each for each in s3.server.requests if each.fault is not None]


def test_a_drive_to_a_bag_and_back(recordings, s3, faults, tmp_path, capsys):
    drive = recordings[Layout.RAW]
    bag, back = tmp_path / 'local' / 'a.mcap', tmp_path / 'back'
    bag.parent.mkdir()
    assert main(['to-bag', str(drive), str(bag), '-q']) == 0
    assert main(['to-kitti', str(bag), str(back), '-q']) == 0
    stored(s3, f'raw/{drive.parent.name}', drive.parent)
    source = f'{s3.url}/raw/{drive.parent.name}/{drive.name}'

    faults()
    assert main(['to-bag', source, f'{s3.url}/bags/a.mcap', '-q']) == 0
    assert met(s3)
    assert objects_below(s3, 'bags') == {'a.mcap': bag.read_bytes()}

    faults()
    assert main(['to-kitti', f'{s3.url}/bags/a.mcap', f'{s3.url}/back', '-q']) == 0
    assert met(s3)
    assert objects_below(s3, 'back') == files_of(back)
    assert not s3.unfinished()
    assert capsys.readouterr().err == ''
