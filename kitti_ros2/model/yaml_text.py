# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""YAML texts of any origin, parsed by libyaml where that parses like PyYAML's own parser."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import yaml

from .errors import shown

if TYPE_CHECKING:
    from collections.abc import Collection

_DEEPEST = 100
_MOST_REPEATED = 100_000
_LONGEST_NUMBER = 5000
_MOST_BITS = 14_000
"""Limit for a whole number, about 4200 digits: Python writes no more than 4300."""
_NUMBERS = ('tag:yaml.org,2002:int', 'tag:yaml.org,2002:float')
_MERGE = 'tag:yaml.org,2002:merge'
# ASCII but tabs and question marks, some of which libyaml takes and PyYAML refuses.
_COMMON = re.compile(rb'[\n -> @-~]*')


class YamlTextError(ValueError):
    """A text is no YAML, or none that is read here.

    Attributes:
        line: Number of the line from 1; None if it is not known.
        problem: The problem, one line.
    """

    def __init__(self, problem: str, line: int | None = None) -> None:
        super().__init__(problem if line is None else f'line {line}: {problem}')
        self.problem = problem
        self.line = line


def load_yaml(text: str | bytes, as_text: Collection[str] = ()) -> Any:  # noqa: ANN401 - any type
    """Return the value of a YAML text, the same with and without libyaml.

    Args:
        text: The text.
        as_text: Types of plain values that stay text: int, float, bool, timestamp.

    Raises:
        YamlTextError: The text is not YAML, a value is invalid (a date, a number of 5000 digits),
            it is nested more than 100 deep, aliases repeat its parts more than 100,000 times, or a
            mapping has a key twice.
    """
    kinds = _loaders(frozenset(as_text))
    data = text if isinstance(text, bytes) else text.encode('utf-8', 'surrogatepass')
    if _COMMON.fullmatch(data):
        try:
            return _load(text, kinds[0])
        except (yaml.YAMLError, ValueError):
            pass  # PyYAML takes a few texts that libyaml refuses, and names the error
    try:
        return _load(text, kinds[1])
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        problem = error.problem or str(error)
        raise YamlTextError(problem, None if mark is None else mark.line + 1) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise YamlTextError(' '.join(str(error).split())) from None


def _load(text: str | bytes, kind: type[Any]) -> Any:  # noqa: ANN401 - any type
    loader = kind(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _Expansion().check(node)
        return loader.construct_document(node)
    finally:
        loader.dispose()


class _Expansion:
    """The size of a text with its aliases written out, which its value has when it is printed."""

    def __init__(self) -> None:
        self._sizes: dict[yaml.Node, tuple[int, int] | None] = {}

    def check(self, root: yaml.Node) -> None:
        """Refuse a node that aliases make too large, too deep or endless."""
        size, depth = self._measure(root)
        if size > _MOST_REPEATED + 10 * len(self._sizes):
            raise yaml.YAMLError('its aliases repeat too much')
        if depth > _DEEPEST:
            raise yaml.YAMLError('nested too deeply')

    def _measure(self, node: yaml.Node) -> tuple[int, int]:
        """Return how many nodes there are, and how deep they are nested."""
        if node in self._sizes:
            measured = self._sizes[node]
            if measured is None:
                raise yaml.YAMLError('an alias refers to what it is in')
            return measured
        self._sizes[node] = None
        _check_keys(node)
        size, depth = 1, 0
        for part in _parts(node):
            part_size, part_depth = self._measure(part)
            size += part_size
            depth = max(depth, part_depth)
        self._sizes[node] = size, depth + 1
        return size, depth + 1


def _check_keys(node: yaml.Node) -> None:
    """Refuse a mapping that has a key twice: of its values all but the last would be lost."""
    seen = set()
    for key, _ in node.value if isinstance(node, yaml.MappingNode) else ():
        if isinstance(key, yaml.ScalarNode) and key.tag != _MERGE:
            if (key.tag, key.value) in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f'the key {shown(key.value)} is there twice', key.start_mark
                )
            seen.add((key.tag, key.value))


def _parts(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return node.value if isinstance(node, yaml.SequenceNode) else []


def _too_long(node: yaml.Node) -> yaml.constructor.ConstructorError:
    problem = 'a number of too many digits'
    return yaml.constructor.ConstructorError(None, None, problem, node.start_mark)


class _Bounded:
    """Stops at a depth: the recursion of both parsers would end in an error, or in a crash.

    And PyYAML raises errors of Python at values that do not fit their tags, such as !!float '', and
    takes numbers to other bases than 10 of a length that Python cannot write again.
    """

    depth = 0

    def construct_object(self, node: Any, deep: bool = False) -> Any:  # noqa: ANN401, FBT001, FBT002
        if node.tag in _NUMBERS and len(node.value) > _LONGEST_NUMBER:
            raise _too_long(node)
        try:
            constructed = super().construct_object(node, deep=deep)  # type: ignore[misc]
        except OverflowError:
            raise _too_long(node) from None
        except (AttributeError, LookupError, TypeError):
            problem = f'a value that is no {node.tag.rpartition(":")[2]}'
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark) from None
        if type(constructed) is int and constructed.bit_length() > _MOST_BITS:
            raise _too_long(node)
        return constructed

    def descend_resolver(self, *node: Any) -> None:  # noqa: ANN401 - as the base class has it
        self.depth += 1
        if self.depth > _DEEPEST:
            raise yaml.YAMLError('nested too deeply')
        super().descend_resolver(*node)  # type: ignore[misc]

    def fetch_flow_collection_start(self, kind: type[yaml.Token]) -> None:
        # PyYAML scans 1024 characters ahead, and all levels again at each of them.
        if self.flow_level >= _DEEPEST:  # type: ignore[attr-defined]
            raise yaml.YAMLError('nested too deeply')
        super().fetch_flow_collection_start(kind)  # type: ignore[misc]

    def ascend_resolver(self) -> None:
        self.depth -= 1
        super().ascend_resolver()  # type: ignore[misc]


@lru_cache(maxsize=4)
def _loaders(as_text: frozenset[str]) -> tuple[type[Any], type[Any]]:
    """Return a loader with libyaml if PyYAML is built with it, and one without."""
    resolvers = {
        first: [item for item in items if item[0].rpartition(':')[2] not in as_text]
        for first, items in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def bounded(base: type[Any]) -> type[Any]:
        return type('Loader', (_Bounded, base), {'yaml_implicit_resolvers': resolvers})

    plain = bounded(yaml.SafeLoader)
    fast = getattr(yaml, 'CSafeLoader', None)
    return plain if fast is None else bounded(fast), plain
