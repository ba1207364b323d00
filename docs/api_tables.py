# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The reference of the library, from its docstrings and signatures."""

from __future__ import annotations

import inspect
import re
from dataclasses import is_dataclass
from enum import Enum
from functools import cached_property
from operator import attrgetter
from textwrap import dedent
from typing import TYPE_CHECKING, Any

from markdown_tables import code, entries, escape

import kitti_ros2.datasets
import kitti_ros2.evaluation

if TYPE_CHECKING:
    from collections.abc import Iterator

_SECTION = re.compile(r'^([A-Z]\w+):\n((?:(?: {4}.*)?(?:\n|$))+)', re.MULTILINE)
_TITLES = {'Args': 'Arguments'}


def api(*names: str) -> str:
    """Return the headings, signatures and docstrings of public names and their members."""
    return '\n\n'.join(part for name in names for part in _described(name))


def _described(name: str) -> Iterator[str]:
    found = attrgetter(name)(kitti_ros2)
    yield f'### {code(name)}'
    if inspect.isfunction(found) or is_dataclass(found):
        yield _block('python', f'{name.rpartition(".")[2]}{_signature(found)}')
    yield from _docstring(found)
    if not inspect.isclass(found):
        return
    for member, value in vars(found).items():
        if not member.startswith('_') and _is_documented(value):
            function = inspect.unwrap(getattr(value, '__func__', value))
            is_method = inspect.isfunction(function)
            yield f'#### {code(f"{found.__name__}.{member}")}'
            if is_method:
                yield _block('python', f'{member}{_signature(function)}')
            yield from _docstring(value)


def _is_documented(value: object) -> bool:
    kinds = (property, cached_property, staticmethod, classmethod)
    return (inspect.isfunction(value) or isinstance(value, kinds)) and bool(inspect.getdoc(value))


def _signature(function: Any) -> str:  # noqa: ANN401 - a function or a dataclass
    signature = inspect.signature(function)
    parameters = [
        each.replace(default=each.default.value) if isinstance(each.default, Enum) else each
        for each in signature.parameters.values()
        if each.name not in {'self', 'cls'}
    ]
    text = str(signature.replace(parameters=parameters))
    return re.sub(r"(: |-> )'([^']*)'", r'\1\2', text)  # annotations are texts


def _docstring(found: object) -> Iterator[str]:
    """Yield the parts of a docstring: its text, and a list for each section."""
    text = inspect.getdoc(found) or ''
    yield escape(_SECTION.sub('', text).strip())
    for title, body in _SECTION.findall(text):
        if title == 'Examples':
            yield _block('pycon', dedent(body).strip())
            continue
        yield f'**{_TITLES.get(title, title)}**'
        if title in {'Returns', 'Yields'}:
            yield escape(dedent(body).strip())
        else:
            listed = entries(body).items()
            yield '\n'.join(f'- {code(name)}: {escape(about)}' for name, about in listed)


def _block(language: str, text: str) -> str:
    return f'```{language}\n{text}\n```'
