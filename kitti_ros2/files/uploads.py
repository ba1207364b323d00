# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Local files sent to a store: several at a time, large ones in parts, memory bounded.

On S3 an object of several parts appears when its multipart upload is completed; one that is not is
aborted, so that the store does not keep its parts. What arrived is compared by size, and by MD5
where the store has it.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ..model.errors import RemoteError
from .filesystems import filesystem_of, key_of
from .remote_requests import attempt
from .store_objects import StoredObject, StoreError, md5_of, object_at, remove_objects
from .workers import ordered_map

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from .filesystems import FileSystem
    from .remote import RemotePath

    Sent = tuple[RemotePath, StoredObject]

PART = 8 << 20
"""Bytes of a part; S3 takes 5 MiB to 5 GiB."""
_MOST_PARTS = 10_000  # of one object, on S3
_WHOLE_OBJECTS = {'gs', 'gcs', 'abfs', 'abfss', 'az', 'adl', 'oci', 'oss', 'obs', 'memory'}
"""Schemes of stores in which an object appears when its last byte has arrived."""
_AT_ONCE = 10  # requests, as botocore has connections; each holds a part in memory


@dataclass(frozen=True)
class Upload:
    """A file and the object that it becomes."""

    source: Path
    target: RemotePath


def send(uploads: Iterable[Upload]) -> Iterator[Sent]:
    """Send files; yield each object as it should be, when it is complete.

    Args:
        uploads: In the order in which they are sent and yielded.

    Raises:
        StoreError: The store refuses; no object is there in part.
        OSError: A file cannot be read.
    """
    pending: list[_Multipart] = []
    results = ordered_map(_call, _tasks(uploads, pending), _AT_ONCE)
    try:
        for result in results:
            if result is None:
                continue
            if isinstance(result, _Multipart):
                yield result.target, result.complete()
                pending.remove(result)
            else:
                yield result
    finally:
        # Threads first: a part that arrives after the abort would stay.
        results.close()
        for each in pending:
            each.abort()


def is_same(expected: StoredObject, found: StoredObject | None) -> bool:
    """Whether an object arrived as it was sent, as far as the store shows it."""
    if found is None or found.size != expected.size:
        return False
    # A store may divide a file in its own parts, and say so in its digest.
    comparable = bool(found.digest) and ('-' in found.digest) is ('-' in expected.digest)
    return not comparable or found.digest == expected.digest


def _call(task: Callable[[], Sent | _Multipart | None]) -> Sent | _Multipart | None:
    return task()


def _tasks(
    uploads: Iterable[Upload], pending: list[_Multipart]
) -> Iterator[Callable[[], Sent | _Multipart | None]]:
    for upload in uploads:
        system = filesystem_of(upload.target)
        size = upload.source.stat().st_size
        if not hasattr(system, 'call_s3'):
            yield partial(_send_whole, upload, system)
        elif size <= PART:
            yield partial(_put, upload, system)
        else:
            multipart = _Multipart.begin(upload, system, size)
            pending.append(multipart)
            yield from (partial(multipart.send, number) for number in range(multipart.parts))


def _put(upload: Upload, system: FileSystem) -> Sent:
    data = upload.source.read_bytes()
    expected = StoredObject(len(data), md5_of(data).hex())
    try:
        _ask(upload.target, lambda: system.pipe_file(key_of(upload.target), data))
    except StoreError:
        if not _is_there(upload.target, expected):
            raise
    return upload.target, expected


def _send_whole(upload: Upload, system: FileSystem) -> Sent:
    """Send a file as the file system does it; where objects are files, under another name first."""
    target = upload.target
    if target.scheme in _WHOLE_OBJECTS:
        _ask(target, lambda: system.put_file(str(upload.source), key_of(target)))
    else:
        part = key_of(target.with_name(f'.{target.name}.part'))
        _ask(target, lambda: system.put_file(str(upload.source), part))
        remove_objects([target])
        _ask(target, lambda: system.mv(part, key_of(target)))
    digest = hashlib.md5(usedforsecurity=False)
    size = 0
    with upload.source.open('rb') as file:
        while block := file.read(PART):
            digest.update(block)
            size += len(block)
    return upload.target, StoredObject(size, digest.hexdigest())


@dataclass(eq=False)
class _Multipart:
    """A multipart upload of S3."""

    source: Path
    target: RemotePath
    size: int
    part_size: int
    name: dict[str, str]
    system: Any
    tags: dict[int, str] = field(default_factory=dict)
    digests: dict[int, bytes] = field(default_factory=dict)

    @classmethod
    def begin(cls, upload: Upload, system: FileSystem, size: int) -> _Multipart:
        """Begin an upload."""
        bucket, key, _ = system.split_path(key_of(upload.target))
        name = {'Bucket': bucket, 'Key': key}
        answer = _ask(upload.target, lambda: system.call_s3('create_multipart_upload', **name))
        name['UploadId'] = answer['UploadId']
        part_size = max(PART, -(-size // _MOST_PARTS))
        return cls(upload.source, upload.target, size, part_size, name, system)

    @property
    def parts(self) -> int:
        """The number of parts."""
        return -(-self.size // self.part_size)

    def send(self, index: int) -> _Multipart | None:
        """Send a part, counted from 0; return the upload with the last one."""
        with self.source.open('rb') as file:
            file.seek(index * self.part_size)
            data = file.read(self.part_size)
        answer = _ask(
            self.target,
            lambda: self.system.call_s3(
                'upload_part', **self.name, PartNumber=index + 1, Body=data
            ),
        )
        self.tags[index] = answer['ETag']
        self.digests[index] = md5_of(data)
        return self if index == self.parts - 1 else None

    def complete(self) -> StoredObject:
        """Let the object appear; return it as it should be."""
        digest = md5_of(b''.join(self.digests[index] for index in range(self.parts))).hex()
        expected = StoredObject(self.size, f'{digest}-{self.parts}')
        parts = [{'PartNumber': index + 1, 'ETag': self.tags[index]} for index in range(self.parts)]
        self._abort_earlier()
        try:
            _ask(
                self.target,
                lambda: self.system.call_s3(
                    'complete_multipart_upload', **self.name, MultipartUpload={'Parts': parts}
                ),
            )
        except StoreError:
            # After an answer that was lost there is no such upload any more.
            if not _is_there(self.target, expected):
                raise
        return expected

    def abort(self) -> None:
        """Remove the parts; never raises an error of the store."""
        with suppress(StoreError):
            _ask(self.target, lambda: self.system.call_s3('abort_multipart_upload', **self.name))

    def _abort_earlier(self) -> None:
        """Abort earlier uploads of the same object: of a killed run, or begun by a lost answer."""
        bucket, key = self.name['Bucket'], self.name['Key']
        with suppress(StoreError):  # it needs a permission of its own
            answer = _ask(
                self.target,
                lambda: self.system.call_s3('list_multipart_uploads', Bucket=bucket, Prefix=key),
            )
            begun = {
                each['UploadId']: each['Initiated']
                for each in answer.get('Uploads', ())
                if each['Key'] == key
            }
            own = begun.pop(self.name['UploadId'], None)
            for upload, initiated in begun.items():
                # A later one is of a run that has taken over.
                if own is not None and initiated <= own:
                    replace(self, name={**self.name, 'UploadId': upload}).abort()


def _is_there(target: RemotePath, expected: StoredObject) -> bool:
    """Whether an object has arrived though its request failed: an answer may have been lost."""
    with suppress(StoreError):
        found = object_at(target)
        return found is not None and found.digest == expected.digest
    return False


def _ask(target: RemotePath, request: Callable[[], Any]) -> Any:  # noqa: ANN401 - the store's answer
    try:
        return attempt(target, request)
    except (OSError, RemoteError) as error:
        raise StoreError(target, error) from error
