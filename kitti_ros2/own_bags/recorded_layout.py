# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The original layout of a recording, from /kitti/source/* of bags written by to-bag.

It maps every sample to its file: the text files of a layout map stamps to file numbers, and the
description maps streams to folders. The description also lists the files in the bag, so that a lost
message is detected.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

from ..bags.decoding import Decoder
from ..bags.reader import open_messages, opened, path_of
from ..importer.report import LossTally, damage
from ..messages.moment import Origin
from ..messages.source import CALIBRATION, FILES, RECORDING
from ..messages.topics import decoders, own_topics
from ..model.errors import BadBagError
from ..model.losses import Loss
from ..model.msgtypes import STRING
from .blueprint import Blueprint
from .description import (
    DescribedRecording,
    EarlierVersionError,
    UndescribedError,
    parse_description,
)
from .earlier_descriptions import implied_texts, without_absent_streams
from .source_texts import TEXT_FILE, TextFiles

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..bags.reader import BagMessages, BagSource
    from ..model.samples import TextFile
    from .description import RecordingDescription

__all__ = [
    'EarlierVersionError',
    'UndescribedError',
    'find_blueprint',
    'read_blueprint',
]


def find_blueprint(source: BagSource) -> Blueprint | None:
    """Read the layout of the recording in a bag; None unless to-bag wrote the bag.

    Raises:
        UndescribedError: to-bag wrote it, and its description is missing, invalid or too old.
        BadBagError: It is not a bag, or its description names folders outside of its root.
    """
    with opened(source) as bag:
        with open_messages(bag) as messages:
            topics = frozenset(topic for topic, _ in messages.channels)
            unread = tuple(loss for _, loss in messages.left_out if loss.stream in own_topics())
            damaged: dict[str, int | None] = dict.fromkeys(messages.losses, 0)
            is_own = (RECORDING, STRING) in messages.channels
        if not is_own:
            return None
        with open_messages(bag, {RECORDING, FILES, CALIBRATION} & topics) as messages:
            texts = _Source(messages, bag.path)
            damaged |= messages.losses
    found = texts.blueprint(topics, damaged)
    return replace(found, losses=(*unread, *found.losses))


def read_blueprint(
    bag: BagSource, counts: Mapping[str, int]
) -> tuple[Blueprint | None, tuple[Loss, ...]]:
    """Read the layout of the recording in a bag, as find_blueprint; also return its missing data.

    An unusable description is a loss, and not an error; one of an earlier version is neither.

    Args:
        bag: A bag that can be read; without a readable description, it has no layout.
        counts: Its messages by topic.
    """
    if RECORDING not in counts:
        return None, ()
    try:
        found = find_blueprint(bag)
    except EarlierVersionError:
        return None, ()
    except BadBagError as error:
        return None, (Loss(RECORDING, 1, str(error)),)
    if found is None:
        return None, ()
    damaged = damage(found.damage, path_of(bag).name)
    return found, (*damaged, *found.losses, *found.shortfall(counts))


class _Source:
    """The content of /kitti/source/{recording,files,calibration}, from a pass over them."""

    def __init__(self, messages: BagMessages, path: Path) -> None:
        self._path = path
        self._tally = LossTally()
        self._description: RecordingDescription | None = None
        self._found: list[tuple[str, int, TextFile]] = []
        decode = Decoder(messages.typestore)
        for message in messages:
            try:
                decoded = decode(message, STRING)
            except ValueError as error:
                self._tally.lose(message.topic, message.stamp_ns, str(error))
                continue
            if message.topic == RECORDING:
                self._description = parse_description(decoded, path)
            else:
                text = decoders()[message.topic](decoded, Origin(path))
                self._found.append((message.topic, message.stamp_ns, text))

    def blueprint(self, topics: frozenset[str], damaged: Mapping[str, int | None]) -> Blueprint:
        """Make the layout and its text files; invalid or missing ones are losses."""
        description = self._description
        if description is None:
            reasons = [*(loss.text() for loss in self._tally.losses()), *damaged]
            because = f' ({reasons[0]})' if reasons else ''
            raise UndescribedError(self._path, f'has no readable {RECORDING}{because}')
        found = self._files(description)
        texts, calibrations = found.of(FILES), found.of(CALIBRATION)
        present = dict.fromkeys((*texts, *calibrations))
        if description.texts is None:
            description = without_absent_streams(description, topics)
            listed = implied_texts(description, topics, present)
        else:
            listed = (*description.texts, *description.calibrations)
        missing = [path for path in dict.fromkeys(listed) if path not in present]
        absent = (Loss(TEXT_FILE, 1, f'the bag does not hold {path}') for path in missing)
        return Blueprint(
            texts=texts,
            calibrations=calibrations,
            topics=topics,
            missing=frozenset(missing),
            losses=(*self._tally.losses(), *absent),
            damage=damaged,
            **{each.name: getattr(description, each.name) for each in fields(DescribedRecording)},
        )

    def _files(self, description: RecordingDescription) -> TextFiles:
        """Collect the valid text files; the others are losses."""
        listed = {FILES: description.texts, CALIBRATION: description.calibrations}
        found = TextFiles(description.folders, {} if description.texts is None else listed)
        for topic, stamp_ns, file in self._found:
            try:
                found.add(topic, file)
            except ValueError as error:
                self._tally.lose(topic, stamp_ns, str(error))
        return found
