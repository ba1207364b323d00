# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Decoding of messages by the definitions in their bags."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..messages.fields import lacking_field

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from .reader import BagMessage


class Decoder:
    """A decoder of messages whose types have all the fields that are read.

    Args:
        typestore: The types as the bags define them.
        lent: Whether arrays of large messages may be views of the chunks of the bag; only where
            all of these are dropped before many more messages are read.
    """

    def __init__(self, typestore: Typestore, *, lent: bool = False) -> None:
        self._typestore = typestore
        self._lent = lent
        self._missing: dict[str, str] = {}

    def __call__(self, message: BagMessage, expected: str = '') -> Any:  # noqa: ANN401 - of the bag's types
        """Decode a message to an object.

        Args:
            message: Of a bag with these types.
            expected: The type it must have; any if empty.

        Raises:
            ValueError: The message cannot be decoded, is of another type than expected, or a field
                is missing in its type.
        """
        msgtype = message.msgtype
        if expected and msgtype != expected:
            raise ValueError(f'is a {msgtype}, not a {expected}')
        if msgtype not in self._missing:
            self._missing[msgtype] = lacking_field(self._typestore, msgtype)
        if self._missing[msgtype]:
            raise ValueError(
                f'cannot be decoded (the bag defines {msgtype} without {self._missing[msgtype]},'
                f' or as another kind of value)'
            )
        data = message.data if self._lent else bytes(message.data)
        try:
            return self._typestore.deserialize_cdr(data, msgtype)
        except Exception as error:  # generated code may raise anything
            raise ValueError(f'cannot be decoded ({error})') from error
