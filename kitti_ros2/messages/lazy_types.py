# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Typestores that make the classes and functions of types when a message first needs them.

rosbags makes all of a type at once, in 3 ms and 30 kB: a class, and 12 functions of which a reader
needs one. A bag may define tens of thousands of types, and every command that opens one waits.
"""

from __future__ import annotations

from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any, cast

from rosbags.serde import cdr, ros1
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.store import Typestore
from rosbags.typesys.stores import empty

from .type_definitions import closure

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosbags.interfaces import Msgdef
    from rosbags.interfaces.typing import Typesdict


class LazyClasses(dict[str, Any]):
    """The Python classes of types.

    Args:
        made: Classes that are there already.
        definitions: Of all types.
    """

    def __init__(self, made: Mapping[str, Any], definitions: Typesdict) -> None:
        super().__init__(made)
        self._definitions = definitions
        self._lock = Lock()  # a type has one class, whichever threads ask for it

    def __missing__(self, msgtype: str) -> Any:  # noqa: ANN401 - classes of rosbags
        with self._lock:
            if msgtype not in self:
                needed = [name for name in closure(self._definitions, msgtype) if name not in self]
                store = Typestore()
                store.register({name: self._definitions[name] for name in needed})
                self.update(store.types)
        return self[msgtype]


class LazyFunctions:
    """The functions of a type, with the attributes of rosbags.interfaces.Msgdef.

    Args:
        name: The type.
        store: Defines it and those in it.

    Raises:
        KeyError: It does not.
    """

    def __init__(self, name: str, store: Typestore) -> None:
        self.name = name
        self.fields = [
            (normalize_fieldname(field), kind) for field, kind in store.fielddefs[name][1]
        ]
        self.store = store

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - functions, sizes and a class
        if name not in _MADE:
            raise AttributeError(name)
        made = self.__dict__[name] = _MADE[name](self)
        return made


def _converter(generate: Callable[..., object], of: LazyFunctions, *, copy: bool) -> object:
    return generate(of.fields, of.name, of.store, copy=copy)


_MADE: dict[str, Callable[[LazyFunctions], object]] = {
    'cls': lambda of: of.store.types[of.name],
    'cdr_sizes': lambda of: cdr.generate_getsize_cdr(of.fields, of.store),
    'getsize_cdr': lambda of: of.cdr_sizes[0],
    'size_cdr': lambda of: of.cdr_sizes[1],
    'serialize_cdr_le': lambda of: cdr.generate_serialize_cdr(of.fields, of.store, 'le'),
    'serialize_cdr_be': lambda of: cdr.generate_serialize_cdr(of.fields, of.store, 'be'),
    'deserialize_cdr_le': lambda of: cdr.generate_deserialize_cdr(of.fields, of.store, 'le'),
    'deserialize_cdr_be': lambda of: cdr.generate_deserialize_cdr(of.fields, of.store, 'be'),
    'ros1_sizes': lambda of: ros1.generate_getsize_ros1(of.fields, of.store),
    'getsize_ros1': lambda of: of.ros1_sizes[0],
    'size_ros1': lambda of: of.ros1_sizes[1],
    'serialize_ros1': lambda of: ros1.generate_serialize_ros1(of.fields, of.store),
    'deserialize_ros1': lambda of: ros1.generate_deserialize_ros1(of.fields, of.store),
    'getsize_ros1_to_cdr': partial(_converter, ros1.generate_ros1_to_cdr, copy=False),
    'ros1_to_cdr': partial(_converter, ros1.generate_ros1_to_cdr, copy=True),
    'getsize_cdr_to_ros1': partial(_converter, ros1.generate_cdr_to_ros1, copy=False),
    'cdr_to_ros1': partial(_converter, ros1.generate_cdr_to_ros1, copy=True),
}


class LazyTypestore(Typestore):
    """A typestore whose functions are made when they are needed."""

    def get_msgdef(self, typename: str) -> Msgdef[object]:
        """Return the functions of a type.

        Raises:
            KeyError: It is not defined.
        """
        if typename not in self.cache:
            self.cache[typename] = cast('Msgdef[object]', LazyFunctions(typename, self))
        return self.cache[typename]


def lazy_typestore(types: Typesdict, lazy: Typesdict) -> LazyTypestore:
    """Make a store of types, and of Time and Duration.

    Args:
        types: Definitions whose classes are made at once.
        lazy: Definitions whose classes are made when one is needed.
    """
    store = LazyTypestore(empty)
    store.register(types)
    store.fielddefs = {**lazy, **store.fielddefs}
    store.types = LazyClasses(store.types, store.fielddefs)
    return store
