# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs in a store: made in a local temporary folder, and sent when they are complete.

An output of one file is one object, which appears whole or not at all. One of several files has
no such moment, as a store cannot rename folders. Its files are sent under a marker, the object
``.{name}.partial`` beside the output, which is sent first and removed last. Readers refuse an
output with its marker, and the next run replaces it.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from ..model.errors import OutputError, OutputExistsError
from .local_staging import Staging
from .remote_listing import forget
from .store_objects import (
    StoreError,
    object_at,
    objects_at,
    read_object,
    refuse_read_only,
    remove_objects,
    write_object,
)
from .upload_marker import marker_of
from .uploads import Upload, is_same, send

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from .remote import RemotePath
    from .store_objects import StoredObject

_LAST = 'metadata.yaml'
"""Makes files a bag: the last to be sent."""
_VERIFICATIONS = 3


class UploadStaging:
    """A local temporary place for an output in a store until it is complete; as Staging.

    Attributes:
        path: The output.
        content: Where to write it: a path that does not exist yet, in a local temporary folder.

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
        self._local = Staging(_local_place(path), lambda _: None)
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

    def tell_remains(self, error: BaseException) -> None:
        """Correct the text of an OutputError where the local copy could not be removed."""
        self._local.tell_remains(error)

    def _find_replaced(self) -> tuple[Mapping[str, StoredObject], bool]:
        """Return the objects to replace, and whether they are of an upload that did not end."""
        forget(self.path)
        found = objects_at(self.path)
        marked = object_at(self._marker) is not None
        if found and not marked:
            refusal = self._refusal(self.path)
            if refusal is not None:
                raise OutputExistsError(self.path, refusal)
        return found, marked

    def _publish_folder(self, replaced: Mapping[str, StoredObject]) -> None:
        uploads = self._uploads()
        run = f'The upload of {self.path.name} is not complete. Run {secrets.token_hex(8)}.\n'
        write_object(self._marker, run.encode())
        try:
            sent = self._send(each for each in uploads if each.target.name != _LAST)
            sent |= self._send(each for each in uploads if each.target.name == _LAST)
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
            found = f' and has sent {foreign[0]}' if foreign else ''
            raise StoreError(self.path, OSError(f'another run is writing it{found}'))

    def _uploads(self) -> list[Upload]:
        """Return the files of the content in order of their names."""
        files = sorted(
            Path(folder, name) for folder, _, names in os.walk(self.content) for name in names
        )
        return [Upload(each, self.path / each.relative_to(self.content)) for each in files]

    @staticmethod
    def _send(uploads: Iterable[Upload]) -> dict[RemotePath, StoredObject]:
        return dict(send(uploads))

    def _verify(self, sent: Mapping[RemotePath, StoredObject]) -> Mapping[str, StoredObject]:
        """Compare what is in the store with what was sent; send again what differs.

        Returns:
            All objects of the output.
        """
        for _ in range(_VERIFICATIONS):
            found = objects_at(self.path)
            by_path = {
                self.path / name if name else self.path: each for name, each in found.items()
            }
            bad = [path for path, each in sent.items() if not is_same(each, by_path.get(path))]
            if not bad:
                return found
            names = [path.names[len(self.path.names) :] for path in bad]
            sources = [self.content.joinpath(*each) for each in names]
            self._send(map(Upload, sources, bad))
        if self.content.is_file():
            remove_objects([self.path])
        raise StoreError(bad[0], OSError('it differs in the store from what was sent'))


def _local_place(path: RemotePath) -> Path:
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
