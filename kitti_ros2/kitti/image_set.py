# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Lists of frames or sequences: ImageSets/train.txt, one name a line, LF at each end.

Object sets list frames by six digits, other layouts sequences or drives by their names. They are
no part of KITTI: training frameworks (SECOND, OpenPCDet, mmdet3d) expect them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .names import FRAME_DIGITS, FileNames, SIX_DIGITS

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


_MARK = '\ufeff'
_COUNTED = ('are ', 'repeat ', 'have not ')


@dataclass(frozen=True)
class ImageSet:
    """A list as its file has it.

    Attributes:
        entries: The names, each once, in the order of the file.
        invalid: Reasons of the lines that are no name, with file and line.
        repaired: What a reader may not accept: repeated, blank, CRLF or short lines.
    """

    entries: tuple[str, ...]
    invalid: tuple[str, ...] = ()
    repaired: tuple[str, ...] = ()


def parse_image_set(
    text: str, path: Path | str, *, frames: bool, known: FileNames = SIX_DIGITS
) -> ImageSet:
    """Parse a list.

    Args:
        text: Its content.
        path: For the reasons.
        frames: Whether names are those of frames, as in object sets.
        known: How the frames are named.
    """
    entries: dict[str, int] = {}
    invalid: list[str] = []
    repaired: dict[str, list[int]] = {}
    if text.startswith(_MARK):
        repaired['begin with a byte order mark'] = [1]
        text = text.removeprefix(_MARK)
    if '\r' in text:
        repaired['end in CRLF'] = [text[: text.index('\r')].count('\n') + 1]
    for place, line in enumerate(text.rstrip().splitlines(), 1):
        word = line.strip()
        name = _frame_name(word, known) if frames else word
        if not word:
            repaired.setdefault('are blank', []).append(place)
        elif name is None or len(word.split()) > 1:
            expected = _expected(known) if frames else 'one name'
            invalid.append(f'{path}:{place}: {word!r}; expected {expected}')
        elif name in entries:
            repaired.setdefault('repeat another', []).append(place)
        else:
            if name != word:
                repaired.setdefault(_unlike(known), []).append(place)
            entries[name] = place
    return ImageSet(tuple(entries), tuple(invalid), tuple(_remarks(path, repaired)))


def _frame_name(word: str, known: FileNames) -> str | None:
    """Return the name of a frame as its files have it; None if the word is none."""
    number = known.number(word)
    return None if number is None else known.stem(number)


def _expected(known: FileNames) -> str:
    if known.stems:
        return f'the name of a frame, such as {known.stem(0)}'
    return f'a frame number of {_digits(known)} digits'


def _unlike(known: FileNames) -> str:
    return f'have not {_digits(known)} digits'


def _digits(known: FileNames) -> str:
    return 'six' if known.digits == FRAME_DIGITS else str(known.digits)


def _remarks(path: Path | str, repaired: dict[str, list[int]]) -> Iterable[str]:
    for fault, lines in repaired.items():
        count = f'{len(lines)} of the lines' if fault.startswith(_COUNTED) else 'lines'
        yield f'{path}:{lines[0]}: {count} {fault}'


def format_image_set(entries: Iterable[str]) -> str:
    """Format a list; the inverse of parse_image_set."""
    return ''.join(f'{name}\n' for name in entries)
