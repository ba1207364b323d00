# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Text files that a bag written by to-bag no longer holds, made of its other messages.

Files of stamps are those of the messages, exactly. The calibration and poses are made by the plan
of a bag of others, and are not KITTI's own. The caller names each file that is made.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, TypeGuard

from ..bags.reader import Decoder, bag_stamps, open_messages
from ..kitti import names
from ..kitti.text_file import format_times, format_timestamps
from ..messages.cdr import peek_header
from ..messages.naming import SWEEP
from ..messages.source_texts import decode_sweep
from ..messages.topics import own_topics
from ..model.bag_formats import HEADLESS, STRING
from ..model.streams import IMAGE_STREAMS, LAST_NS, Layout, Stream

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from ..bags.bag_files import OpenBag


# Files of stamps, from the messages of their stream.
#
# In KITTI stamps ascend with file numbers. So if a bag has as many messages as there were files,
# those in order of their stamps are of the files in order of their numbers.


def text_of_stamps(
    bag: OpenBag, stream: Stream, numbers: Sequence[int], epoch_ns: int | None
) -> tuple[str, str] | None:
    """Make the file of a stream's stamps; lines of numbers without a file are blank.

    Args:
        bag: The bag.
        stream: The stream, whose messages have the stamps of its files.
        numbers: File numbers that were written to the bag, ascending.
        epoch_ns: The stamp of 0 seconds in a times.txt; None for a timestamps.txt.

    Returns:
        The text, and the topic that it is made of; None without a message for each number.
    """
    counts = {topic: len(stamps) for topic, stamps in bag_stamps(bag).items()}
    rows = (row for row in own_topics().values() if row.stream is stream)
    for topic in (row.topic for row in rows if row.msgtype not in HEADLESS):
        if 0 < len(numbers) <= counts.get(topic, 0):
            stamps_ns = _header_stamps(bag, topic)
            if len(stamps_ns) == len(numbers):
                return _format(numbers, stamps_ns, epoch_ns), topic
    return None


def texts_of_turns(bag: OpenBag, numbers: Sequence[int]) -> tuple[str, ...]:
    """Make the files of starts and of ends of turns; none without a sweep for each number."""
    turns = _turns(bag)
    if not turns or len(turns) != len(numbers):
        return ()
    return tuple(_format(numbers, stamps_ns) for stamps_ns in zip(*turns, strict=True))


def _header_stamps(bag: OpenBag, topic: str) -> list[int]:
    """Return the stamps in the headers of a topic, ascending, each once."""
    stamps_ns = set[int]()
    with open_messages(bag, {topic}, must_read=False) as messages:
        for message in messages:
            try:
                stamps_ns.add(peek_header(message.data)[0])
            except ValueError:  # a damaged message, whose file is lost as well
                continue
    return sorted(filter(_is_stamp, stamps_ns))


def _turns(bag: OpenBag) -> list[tuple[int, int]]:
    """Return start and end of the sweeps that have both, ascending, each once."""
    turns = set[tuple[int, int]]()
    with open_messages(bag, {SWEEP}, must_read=False) as messages:
        decode = Decoder(messages.typestore)
        for message in messages:
            try:
                start_ns, end_ns = decode_sweep(decode(message, STRING))
            except (ValueError, KeyError, TypeError, RecursionError):
                continue
            if _is_stamp(start_ns) and _is_stamp(end_ns):
                turns.add((start_ns, end_ns))
    return sorted(turns)


def _is_stamp(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and 0 <= value <= LAST_NS


def _format(numbers: Sequence[int], stamps_ns: Sequence[int], epoch_ns: int | None = None) -> str:
    """Format stamps by line, the number of their file."""
    if epoch_ns is None:
        lines = format_timestamps(stamps_ns)
    else:
        lines = format_times(stamp - epoch_ns for stamp in stamps_ns)
    by_number = dict(zip(numbers, lines.splitlines(), strict=True))
    return ''.join(f'{by_number.get(number, "")}\n' for number in range(numbers[-1] + 1))


# The calibration, and poses, by the plan of a bag of others.

_NOT_WRITTEN = frozenset({*IMAGE_STREAMS, Stream.SCAN})


def make_by_plan(
    bag: OpenBag, layout: Layout, name: str, lost: Collection[PurePosixPath], frames: int
) -> Mapping[PurePosixPath, bytes]:
    """Make missing text files of the other messages of a bag; those that cannot be made are absent.

    Args:
        bag: The bag.
        layout: The recording's.
        name: The recording's.
        lost: Paths of the missing files, relative to the data set.
        frames: How many frames are restored, if they are numbered from 0 without a gap, else 0:
            only the calibration of all frames does not depend on their numbers.

    Raises:
        KittiRos2Error: The bag has too little for a plan.
        OSError: It cannot be read, or a temporary file cannot be written.
    """
    poses = {path for path in lost if names.POSES in (path.parent.name, path.stem)}
    wanted = {path for path in lost if is_calibration(layout, path)} | (poses if frames else set())
    if not wanted:
        return {}
    from ..importer.apply_plan import guess  # noqa: PLC0415 - for incomplete bags only
    from ..importer.set_builder import Target, build  # noqa: PLC0415
    from ..importer.survey import survey_bags  # noqa: PLC0415
    from ..options.outputs import ImportOptions  # noqa: PLC0415

    options = ImportOptions(layout=layout, name=name)
    survey = replace(survey_bags([bag]), calibrations=())
    plan = guess([bag], survey, options).plan
    with tempfile.TemporaryDirectory() as folder:
        report = build([bag], plan, survey, Target(Path(folder), without=_NOT_WRITTEN), options)
        if report.frames != frames:
            wanted -= poses
        files = {path: Path(folder, path) for path in sorted(wanted)}
        return {path: file.read_bytes() for path, file in files.items() if file.is_file()}


def is_calibration(layout: Layout, path: PurePosixPath) -> bool:
    """Return whether a path is a calibration of all frames; those of single frames are not.

    The static transforms of a frame may be lost as well, and others be taken for them.
    """
    if layout.traits.calibration_per_frame:
        return False
    return path.name in {*names.RAW_CALIB, names.ODOMETRY_CALIB} or path.parent.name == names.CALIB
