# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Typestores of the types of bags, which share the classes and functions that are made of them."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from rosbags.typesys import TypesysError

from ..messages.lazy_types import LazyClasses, LazyTypestore, lazy_typestore

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosbags.interfaces.typing import Typesdict
    from rosbags.typesys.store import Typestore


class SharingTypestore(LazyTypestore):
    """A typestore with the types of another and the functions made for them.

    Types that are registered in one of them are not in the other.
    """

    def __init__(self, typestore: Typestore) -> None:
        super().__init__()
        self.types = typestore.types
        self.fielddefs.update(typestore.fielddefs)
        self.cache = typestore.cache

    def register(self, typs: Typesdict) -> None:
        """Register types in this store alone."""
        self.cache = dict(self.cache)
        self.types = LazyClasses(self.types, self.fielddefs)
        super().register(typs)


class OriginalTexts(SharingTypestore):
    """A typestore that returns the original definition texts, empty ones for unknown types."""

    def __init__(self, typestore: Typestore, texts: Mapping[str, str]) -> None:
        super().__init__(typestore)
        self._texts = texts

    def generate_msgdef(self, typename: str, ros_version: int = 1) -> tuple[str, str]:
        """Return the text of a definition, and its md5 sum for ROS 1."""
        if ros_version == 2 and typename in self._texts:
            return self._texts[typename], ''
        if typename not in self.fielddefs:
            return '', ''
        return super().generate_msgdef(typename, ros_version)

    def hash_rihs01(self, typ: str) -> str:
        """Return the hash of a type, empty if it has none."""
        try:
            return super().hash_rihs01(typ)
        except (KeyError, TypesysError):
            return ''


def typestore_of(types: Typesdict) -> Typestore:
    """Make a store of types; stores of the same types share their classes and functions.

    Making these takes longer than reading a small bag, and the bags of a collection mostly have the
    same types.
    """
    return SharingTypestore(
        _shared(
            tuple(
                (name, tuple(constants), tuple(fields))
                for name, (constants, fields) in types.items()
            )
        )
    )


@lru_cache(maxsize=8)
def _shared(types: tuple[tuple[str, tuple[Any, ...], tuple[Any, ...]], ...]) -> Typestore:
    own = {name: (list(constants), list(fields)) for name, constants, fields in types}
    return lazy_typestore({}, own)
