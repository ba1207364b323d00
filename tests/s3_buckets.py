# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of remote files: an S3 server on 127.0.0.1, a bucket of it, clients that do not wait."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from kitti_ros2.files import remote_requests

if TYPE_CHECKING:
    from collections.abc import Iterator

    from remote.s3_server import S3Server


@dataclass(frozen=True)
class Bucket:
    """A bucket of the server.

    Attributes:
        server: The server, with its faults and counts.
        name: Of the bucket.
        url: Of the bucket, s3://name.
    """

    server: S3Server
    name: str
    url: str

    def objects(self) -> dict[str, bytes]:
        """Return all complete objects by key, past all faults."""
        return self.server.objects(self.name)

    def put(self, key: str, data: bytes) -> None:
        """Write an object, past all faults."""
        self.server.put(self.name, key, data)

    def unfinished(self) -> list[str]:
        """Return the keys of multipart uploads that are neither completed nor aborted."""
        return self.server.unfinished(self.name)


@pytest.fixture(scope='session')
def s3_process() -> Iterator[S3Server]:
    """The server of all tests of a process: clients keep its address."""
    pytest.importorskip('moto', reason='the S3 server of the tests is moto')
    pytest.importorskip('s3fs', reason='s3:// needs s3fs')
    from remote.s3_server import s3_server  # noqa: PLC0415 - it needs moto

    with s3_server() as server:
        yield server


@pytest.fixture
def s3(s3_process: S3Server, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bucket]:
    """A new bucket; this process and those that it starts find the server by the environment."""
    for name, value in s3_process.environment().items():
        monkeypatch.setenv(name, value)
    monkeypatch.delenv('AWS_PROFILE', raising=False)
    name = s3_process.new_bucket()
    try:
        yield Bucket(s3_process, name, f's3://{name}')
    finally:
        s3_process.clear()
        s3_process.remove_bucket(name)


@pytest.fixture
def impatient(s3: Bucket, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bucket]:
    """The bucket, by clients that do not wait between attempts."""
    import s3fs  # noqa: PLC0415 - an extra

    monkeypatch.setattr(remote_requests, 'wait', lambda _: None)
    monkeypatch.setattr(s3fs.S3FileSystem, 'retries', 1)
    monkeypatch.setenv('AWS_MAX_ATTEMPTS', '1')
    forget_clients()
    yield s3
    forget_clients()


def forget_clients() -> None:
    """Let the next request make a client by the present settings."""
    import s3fs  # noqa: PLC0415 - an extra

    s3fs.S3FileSystem.clear_instance_cache()
    remote_requests._filesystem.cache_clear()
