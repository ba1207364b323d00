# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Suggestions for misspelt names, and the error for a value that is none of several."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .errors import UsageError
from .text import either

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

_LEAST_RATIO = 0.75
_LEAST_RATIO_SHORT_WORD = 0.66  # one letter of three
_SHORT_WORD = 5
_MARGIN = 0.03
_MOST = 3


def close_names(word: str, known: Iterable[str]) -> list[str]:
    """Return the names that a word is likely to stand for, best first; three at most.

    Close is a name of other case, one that contains the word, and the most similar ones; none if
    more than three are equally similar.
    """
    from difflib import SequenceMatcher  # noqa: PLC0415 - for errors only

    lower = word.lower()
    names = list(dict.fromkeys(known))
    same = [name for name in names if name.lower() == lower]
    if same or not lower:
        return same[:_MOST]
    matcher = SequenceMatcher(b=lower, autojunk=False)
    ratios = {}
    for name in names:
        matcher.set_seq1(name.lower())
        ratios[name] = matcher.ratio()
    least = _LEAST_RATIO_SHORT_WORD if len(lower) <= _SHORT_WORD else _LEAST_RATIO
    best = max(ratios.values(), default=0.0)
    if best < least:
        containing = [name for name in names if len(lower) > 2 and lower in name.lower()]
        return containing if len(containing) <= _MOST else []
    close = [name for name in names if ratios[name] >= max(least, best - _MARGIN)]
    return sorted(close, key=lambda name: -ratios[name]) if len(close) <= _MOST else []


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return the question for the end of an error, such as ``; did you mean raw?``, or ''."""
    close = close_names(word, known)
    return f'; did you mean {either(close)}?' if close else ''


def not_one_of(name: str, value: object, known: Sequence[str]) -> UsageError:
    """Return the error for a value of an option that is none of its choices."""
    return UsageError(
        f'{name} takes {either(known)}, not {value!r}{did_you_mean(str(value), known)}'
    )
