# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The streams that a selection names."""

from __future__ import annotations

import re

from ..model.errors import UsageError
from ..model.spelling import did_you_mean
from ..model.streams import IMAGE_STREAMS, STREAM_ALIASES, Stream
from ..model.text import either

_CAMERA = re.compile(r'(?:image|camera|cam)_?0?(\d)', re.ASCII)
_PACKETS = {Stream.OXTS, Stream.OXTS_EXTRACT}


def wanted_streams(asked: tuple[str, ...]) -> set[Stream]:
    """Return the streams of the option --streams; all without names.

    Raises:
        UsageError: A name is unknown.
    """
    if not asked:
        return set(Stream)
    wanted: set[Stream] = set()
    for name in asked:
        if name == 'image':
            wanted |= set(IMAGE_STREAMS)
        elif name in {stream.value for stream in Stream}:
            wanted |= _PACKETS if name == Stream.OXTS.value else {Stream(name)}
        else:
            raise _no_stream(name)
    return wanted


def _no_stream(name: str) -> UsageError:
    known = ['image', *(stream.value for stream in Stream)]
    other = STREAM_ALIASES.get(name.lower())
    hint = f'; did you mean {other.value}?' if other else did_you_mean(_numbered(name), known)
    return UsageError(f'there is no stream {name!r}{hint or f"; choose from {either(known)}"}')


def _numbered(name: str) -> str:
    """Return image_2 for the names of a camera in KITTI's folders, and in topics."""
    camera = _CAMERA.fullmatch(name.lower())
    return f'image_{camera[1]}' if camera else name
