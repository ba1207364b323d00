# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a bag opened for reading, of any container, decompressed if rosbag2 packed them."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from ..model.errors import BadBagError
from .decompressors import ZSTD_MAGIC, decompress_file
from .findings import Findings
from .storages import STORAGES
from .summary import BagIndex

if TYPE_CHECKING:
    from .locate import BagFiles
    from .pieces import BagFile


def open_files(bag: BagFiles, findings: Findings, stack: ExitStack) -> list[tuple[Path, BagFile]]:
    """Open the files of a bag; if some of several cannot be read, they are entered as losses.

    Args:
        bag: The bag to open.
        findings: Damage is entered there.
        stack: Closes the files.

    Raises:
        BadBagError: No file can be read.
        OSError: A file cannot be opened.
    """
    for loss in bag.losses:
        findings.lose(loss)
    found: list[tuple[Path, BagFile]] = []
    failure: BadBagError | None = None
    for path in bag.files:
        try:
            plain = _unpacked(path, stack)
            name = path if plain == path else Path(f'{path} (unpacked)')
            file = STORAGES[bag.storage].read(plain, name, findings)
        except BadBagError as error:
            failure = failure or error
            findings.lose(str(error))
            continue
        stack.callback(file.close)
        found.append((path, file))
    if failure is not None and not found:
        raise failure
    if failure is None and not bag.losses:
        known = {channel.topic for _, file in found for channel in file.channels.values()}
        for topic in bag.topics:
            if topic not in known:
                text = f'metadata.yaml names the topic {topic}, which its files lack'
                findings.lose(f'{bag.path}: {text}', 0)
    return found


def index_files(bag: BagFiles) -> BagIndex:
    """Return the stamps of a bag's messages without their payloads.

    Raises:
        BadBagError: It cannot be read at all.
        OSError: A file cannot be opened.
    """
    index, findings = BagIndex(), Findings()
    with ExitStack() as stack:
        for _, file in open_files(bag, findings, stack):
            index.merge(file.index())
    if bag.compression_mode:
        index.compressions.add('zstd')
    index.complete = findings.complete
    index.warnings += findings.warnings
    return index


def _unpacked(path: Path, stack: ExitStack) -> Path:
    """Return the file itself, or a decompressed copy if rosbag2 compressed it as a whole.

    A truncated file is decompressed up to its end.

    Raises:
        BadBagError: The path is a pipe or a device.
        OSError: The file cannot be read, or the disk has no room for the copy.
    """
    if not path.is_file():
        raise BadBagError(path, 'is no regular file')
    with path.open('rb') as source:
        if source.read(len(ZSTD_MAGIC)) != ZSTD_MAGIC:
            return path
        source.seek(0)
        folder = Path(stack.enter_context(TemporaryDirectory()))
        plain = folder / path.stem
        try:
            with plain.open('wb') as target:
                target.writelines(decompress_file(source))
        except OSError as error:
            error.filename = f'{path} (unpacked to {folder.parent})'
            raise
    return plain
