# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Parsers of lists of classes, each with a class, a label or an overlap; see parsers.py."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..model.errors import UsageError
from ..model.least_overlaps import LeastOverlaps
from ..model.text import shown
from .parsers import parse_texts


def parse_class_map(name: str, value: object) -> tuple[tuple[str, str], ...]:
    """Parse classes of results with KITTI's, such as car=Car 3=Pedestrian, or a mapping.

    The last = divides a pair; with nothing after it the class is left out.
    """
    return _parse_pairs(name, value, 'NAME=CLASS, such as car=Car 3=Pedestrian')


def parse_labels(name: str, value: object) -> tuple[tuple[str, str], ...]:
    """Parse KITTI's classes with labels of Autoware, such as Van=TRUCK Tram=BUS, or a mapping."""
    return _parse_pairs(name, value, 'CLASS=LABEL, such as Van=TRUCK Tram=BUS')


def _parse_pairs(name: str, value: object, form: str) -> tuple[tuple[str, str], ...]:
    """Parse pairs divided by the last =; nothing may have two partners."""
    if isinstance(value, Mapping):
        pairs = [(str(own), known) for own, known in value.items()]
    else:
        items = value if isinstance(value, (list, tuple)) else [value]
        pairs = [
            item if isinstance(item, tuple) else str(item).rpartition('=')[::2] for item in items
        ]
    for own, known in pairs:
        if not own or not isinstance(known, str) or any(map(str.isspace, known)):
            given = f'{own}={known}' if own else known
            raise UsageError(f'{name} takes {form}, not {given}')
        if dict(pairs)[own] != known:
            raise UsageError(f'{name}: {own} is given twice, as {known} and {dict(pairs)[own]}')
    return tuple(pairs)


def parse_class_overlaps(name: str, value: object) -> tuple[tuple[str, float | None], ...]:
    """Parse class names, each alone or with an overlap, such as car truck=0.5, or a mapping."""
    if isinstance(value, dict):
        value = [
            each if overlap is None else f'{each}={overlap}' for each, overlap in value.items()
        ]
    pairs = [word.partition('=') for word in parse_texts(name, value)]
    try:
        return tuple(
            (word.lower(), float(overlap) if equals else None) for word, equals, overlap in pairs
        )
    except ValueError:
        given = ' '.join(map(''.join, pairs))
        raise UsageError(
            f'{name} takes names such as car or truck=0.5, not {shown(given)}'
        ) from None


def parse_least_overlaps(name: str, value: object) -> LeastOverlaps:
    """Parse an IoU of all classes, such as 0.5, and those of some, such as Car=0.7."""
    items = value if isinstance(value, (list, tuple)) else [value]
    words = [word for item in items for word in str(item).replace(',', ' ').split()]
    found: dict[str, float] = {}
    for word in words:
        class_name, _, number = word.rpartition('=')
        try:
            found[class_name.lower()] = float(number)
        except ValueError:
            found[class_name.lower()] = math.nan
    valid = all(0 <= overlap < 1 for overlap in found.values())
    if not (words and valid and len(found) == len(words)):
        raise UsageError(
            f'{name} takes an IoU of at least 0 and below 1, such as 0.5, or of a class, such as'
            f' Car=0.5, not {shown(" ".join(words))}'
        )
    others = found.pop('', None)
    return LeastOverlaps(tuple(sorted(found.items())), others)
