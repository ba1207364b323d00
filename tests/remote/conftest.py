# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of remote files: an S3 server on 127.0.0.1, and a bucket of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

    from s3_server import S3Server


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
    from s3_server import s3_server  # noqa: PLC0415 - it needs moto

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
