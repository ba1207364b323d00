# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs in a store: made in a local temporary folder, and sent when complete; locks there.

Files are sent several at a time, large ones in parts; the memory is bounded. On S3 an object of
several parts appears when its multipart upload is completed; one that is not is aborted, so that
the store does not keep its parts. What arrived is compared by size, and by MD5 where the store has
it.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import socket
import tempfile
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..model.errors import KittiRos2Error, OutputError, OutputExistsError, RemoteError
from .local_staging import Staging
from .remote import marker_of
from .remote_reads import forget
from .remote_requests import (
    StoredObject,
    StoreError,
    attempt,
    create_object,
    filesystem_of,
    key_of,
    md5_of,
    object_at,
    objects_at,
    read_object,
    refuse_read_only,
    remove_objects,
    write_object,
)
from .threads import deferred_signals, ordered_map

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from .remote import RemotePath
    from .remote_requests import FileSystem


if TYPE_CHECKING:
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
        for multipart in pending:
            multipart.abort()


def is_same(expected: StoredObject, stored: StoredObject | None) -> bool:
    """Return whether an object arrived as it was sent, as far as the store shows it."""
    if stored is None or stored.size != expected.size:
        return False
    # A store may divide a file in its own parts, and show that in its digest.
    comparable = bool(stored.digest) and ('-' in stored.digest) is ('-' in expected.digest)
    return not comparable or stored.digest == expected.digest


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
                upload['UploadId']: upload['Initiated']
                for upload in answer.get('Uploads', ())
                if upload['Key'] == key
            }
            own = begun.pop(self.name['UploadId'], None)
            for upload, initiated in begun.items():
                # A later one is of a run that has taken over.
                if own is not None and initiated <= own:
                    replace(self, name={**self.name, 'UploadId': upload}).abort()


def _is_there(target: RemotePath, expected: StoredObject) -> bool:
    """Return whether an object has arrived though its request failed: the answer was lost."""
    with suppress(StoreError):
        stored = object_at(target)
        return stored is not None and stored.digest == expected.digest
    return False


def _ask(target: RemotePath, request: Callable[[], Any]) -> Any:  # noqa: ANN401 - the store's answer
    try:
        return attempt(target, request)
    except (OSError, RemoteError) as error:
        raise StoreError(target, error) from error


# Outputs in a store: made in a local temporary folder, and sent when they are complete.
#
# An output of one file is one object, which appears whole or not at all. One of several files has
# no such moment, as a store cannot rename folders. Its files are sent under a marker, the object
# ``.{name}.partial`` beside the output, which is sent first and removed last. Readers refuse an
# output with its marker, and the next run replaces it.

_LAST = 'metadata.yaml'
"""Makes files a bag: the last to be sent."""
_VERIFICATIONS = 3


class UploadStaging:
    """A local temporary directory for an output in a store until it is complete; as Staging.

    Attributes:
        path: The output.
        content: The path to write to, in a local temporary folder; it does not exist yet.

    Args:
        path: The output.
        refusal: Returns the reason why an existing output is kept, None if it may be replaced.

    Raises:
        OutputExistsError: The output exists and may not be replaced.
        OutputError: Another run on this machine is writing it, or the store or the disk refuses.
        UsageError: A package is missing, or the scheme is unknown.
    """

    def __init__(self, path: RemotePath, refusal: Callable[[Path], str | None]) -> None:
        refuse_read_only(path)
        self.path = path
        self._refusal = refusal
        self._marker = marker_of(path)
        self._find_replaced()
        self._local = Staging(_local_path(path), lambda _: None)
        self.content = self._local.content

    def publish(self) -> None:
        """Send the content.

        Raises:
            OutputExistsError: The output was created meanwhile, or may not be replaced.
            OutputError: The store refuses; of an output of several files the marker is left.
        """
        replaced, marked = self._find_replaced()
        if self.content.is_dir():
            self._publish_folder(replaced)
        else:
            sent = self._send([Upload(self.content, self.path)])
            self._verify(sent)
            remove_objects(self.path / name for name in sorted(replaced) if name)
            remove_objects([self._marker] if marked else [])
        forget(self.path)
        self._local.discard()

    def discard(self) -> None:
        """Remove the content; never raises OSError."""
        self._local.discard()

    def note_remains(self, error: BaseException) -> None:
        """Correct the text of an OutputError where the local copy could not be removed."""
        self._local.note_remains(error)

    def _find_replaced(self) -> tuple[Mapping[str, StoredObject], bool]:
        """Return the objects to replace, and whether they are of an upload that did not end."""
        forget(self.path)
        objects = objects_at(self.path)
        marked = object_at(self._marker) is not None
        if objects and not marked:
            refusal = self._refusal(self.path)
            if refusal is not None:
                raise OutputExistsError(self.path, refusal)
        return objects, marked

    def _publish_folder(self, replaced: Mapping[str, StoredObject]) -> None:
        uploads = self._uploads()
        run = f'The upload of {self.path.name} is not complete. Run {secrets.token_hex(8)}.\n'
        write_object(self._marker, run.encode())
        try:
            sent = self._send(upload for upload in uploads if upload.target.name != _LAST)
            sent |= self._send(upload for upload in uploads if upload.target.name == _LAST)
            names = {'/'.join(target.names[len(self.path.names) :]) for target in sent}
            stale = sorted(set(replaced) - names)
            remove_objects(self.path / name if name else self.path for name in stale)
            self._refuse_foreign(sorted(set(self._verify(sent)) - names), run)
            remove_objects([self._marker])
        except StoreError as error:
            remains = (
                f'its upload was not completed: {self._marker} marks it, and the next run with this'
                f' output replaces it'
            )
            raise StoreError(self.path, OSError(error.reason), remains=remains) from error

    def _refuse_foreign(self, foreign: Sequence[str], run: str) -> None:
        """Refuse objects and a marker of another run.

        Raises:
            StoreError: There are some.
        """
        if foreign or read_object(self._marker) != run.encode():
            detail = f' and has sent {foreign[0]}' if foreign else ''
            raise StoreError(self.path, OSError(f'another run is writing it{detail}'))

    def _uploads(self) -> list[Upload]:
        """Return the files of the content in order of their names."""
        files = sorted(
            Path(folder, name) for folder, _, names in os.walk(self.content) for name in names
        )
        return [Upload(file, self.path / file.relative_to(self.content)) for file in files]

    @staticmethod
    def _send(uploads: Iterable[Upload]) -> dict[RemotePath, StoredObject]:
        return dict(send(uploads))

    def _verify(self, sent: Mapping[RemotePath, StoredObject]) -> Mapping[str, StoredObject]:
        """Compare what is in the store with what was sent; send again what differs.

        Returns:
            All objects of the output.
        """
        for _ in range(_VERIFICATIONS):
            objects = objects_at(self.path)
            by_path = {
                self.path / name if name else self.path: stored for name, stored in objects.items()
            }
            bad = [p for p, expected in sent.items() if not is_same(expected, by_path.get(p))]
            if not bad:
                return objects
            names = [path.names[len(self.path.names) :] for path in bad]
            sources = [self.content.joinpath(*relative) for relative in names]
            self._send(map(Upload, sources, bad))
        if self.content.is_file():
            remove_objects([self.path])
        raise StoreError(bad[0], OSError('it differs in the store from what was sent'))


def _local_path(path: RemotePath) -> Path:
    """Return the local path of an output: the same for all runs, so that one finds another's.

    Raises:
        OutputError: The temporary folder cannot be used.
    """
    # In a folder of one's own: the names below can be predicted.
    base = Path(tempfile.gettempdir(), f'kitti_ros2-uploads-{os.getuid()}')
    try:
        base.mkdir(mode=0o700, exist_ok=True)
        state = base.lstat()
    except OSError as error:
        raise OutputError(
            path, f'{base}: {error.strerror}', 'set TMPDIR to another folder'
        ) from error
    if base.is_symlink() or state.st_uid != os.getuid() or state.st_mode & 0o022:
        raise OutputError(path, f'{base} belongs to somebody else', 'set TMPDIR to another folder')
    return base / hashlib.sha256(str(path).encode()).hexdigest()[:16] / path.name


# A lock in a store: an object whose owner writes it anew again and again.
#
# Clocks of machines differ, so that a lease is not a time of day: a lock whose content stays the
# same for the whole lease, as its observer measures it, is left over from a run that was killed.

LEASE_S = 30.0
_RENEWALS = 3  # within a lease
_POLL_S = 1.0


@dataclass
class StoreLock:
    """A lock that this process holds.

    Attributes:
        path: Its object.
        lost: Set if another run has taken the lock.
    """

    path: RemotePath
    lost: threading.Event

    def check(self) -> None:
        """Raise an error if the lock was lost.

        Raises:
            OutputError: Another run has taken it.
        """
        if self.lost.is_set():
            raise OutputError(
                self.path,
                'another run has taken this lock, as this one did not answer for too long',
                'run one of the two again',
            )


@contextmanager
def locked_in_store(
    path: RemotePath, lease_s: float = LEASE_S, wait: Callable[[float], None] = time.sleep
) -> Iterator[StoreLock]:
    """Hold a lock, renewed by a thread.

    Where a store has no conditional requests, two runs that begin at the same time may both
    get it briefly; the one that wrote first notices it at its first renewal.

    Args:
        path: The object.
        lease_s: After which time without renewals the lock is taken over.
        wait: Waits so many seconds.

    Raises:
        OutputError: Another run holds it.
        StoreError: The store cannot be asked.
    """
    lock = _Lock(path, lease_s)
    lock.acquire(wait)
    thread = threading.Thread(target=lock.renew_until_stopped, daemon=True)
    with deferred_signals():  # as the event below, it shares a condition with its thread
        thread.start()
    try:
        yield StoreLock(path, lock.lost)
    finally:
        with deferred_signals():
            lock.stopped.set()
        thread.join()
        lock.release()


class _Lock:
    def __init__(self, path: RemotePath, lease_s: float) -> None:
        self._path = path
        self._lease_s = lease_s
        self._owner = {**_this_process(), 'run': secrets.token_hex(8)}
        self._beat = 0
        self.lost = threading.Event()
        self.stopped = threading.Event()

    def acquire(self, wait: Callable[[float], None]) -> None:
        """Create the object, or take over one that is left over."""
        if create_object(self._path, self._content()):
            return
        seen = read_object(self._path)
        polls = max(1, round(self._lease_s / _POLL_S))
        for _ in range(0 if _is_dead(seen) else polls):
            wait(_POLL_S)
            now = read_object(self._path)
            if now is None:
                break
            if now != seen:
                raise OutputError(
                    self._path.parent,
                    f'another run is writing this ({_describe(now)})',
                    'wait for it, or choose another name',
                )
        remove_objects([self._path])
        if not create_object(self._path, self._content()):
            raise OutputError(
                self._path.parent, 'another run has just begun to write this', 'wait for it'
            )

    def renew_until_stopped(self) -> None:
        """Renew the lock until it is released or lost."""
        while not self.stopped.wait(self._lease_s / _RENEWALS):
            try:
                if not self._is_ours():
                    self.lost.set()
                    return
                self._beat += 1
                write_object(self._path, self._content())
            except KittiRos2Error:
                continue  # the store may answer again; if not, the run fails by itself

    def release(self) -> None:
        """Remove the object if it is ours; never raises an error of the store."""
        with suppress(StoreError):
            if self._is_ours():
                remove_objects([self._path])

    def _content(self) -> bytes:
        return json.dumps({**self._owner, 'beat': self._beat}, sort_keys=True).encode()

    def _is_ours(self) -> bool:
        return _parsed(read_object(self._path)).get('run') == self._owner['run']


def _this_process() -> dict[str, object]:
    return {'host': socket.gethostname(), 'space': _process_space(), 'pid': os.getpid()}


def _process_space() -> str:
    """Return an id of this machine or container: boot and process namespace."""
    with suppress(OSError):
        boot = Path('/proc/sys/kernel/random/boot_id').read_text(encoding='ascii').strip()
        return f'{boot} {Path("/proc/self/ns/pid").readlink()}'
    return ''


def _is_dead(content: bytes | None) -> bool:
    """Return whether a lock is of a process of this machine that has ended."""
    owner = _parsed(content)
    space, pid = owner.get('space'), owner.get('pid')
    if not space or space != _process_space() or owner.get('host') != socket.gethostname():
        return False
    if not isinstance(pid, int):
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return False


def _parsed(content: bytes | None) -> dict[str, object]:
    with suppress(ValueError):
        parsed = json.loads(content or b'{}')
        if isinstance(parsed, dict):
            return parsed
    return {}


def _describe(content: bytes) -> str:
    owner = _parsed(content)
    return f'process {owner.get("pid", "?")} on {owner.get("host", "?")}'
