# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of bags -> objects, by the definitions that the bags bring."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..messages.fields import lacking_field

if TYPE_CHECKING:
    from ..messages.ros_types import Typestore
    from .reader import BagMessage


class Decoder:
    """Decodes messages whose types have the fields that are read of them.

    Args:
        typestore: The types as the bags define them.
    """

    def __init__(self, typestore: Typestore) -> None:
        self._typestore = typestore
        self._lacking: dict[str, str] = {}

    def __call__(self, message: BagMessage) -> Any:  # noqa: ANN401 - of the bag's types
        """The object that a message is.

        Raises:
            ValueError: It cannot be decoded, or its type lacks a field.
        """
        msgtype = message.msgtype
        if msgtype not in self._lacking:
            self._lacking[msgtype] = lacking_field(self._typestore, msgtype)
        if self._lacking[msgtype]:
            raise ValueError(
                f'cannot be decoded (the bag defines {msgtype} without {self._lacking[msgtype]},'
                f' or as another kind of value)'
            )
        try:
            return self._typestore.deserialize_cdr(message.data, msgtype)
        except Exception as error:  # generated code lets anything out
            raise ValueError(f'cannot be decoded ({error})') from error
