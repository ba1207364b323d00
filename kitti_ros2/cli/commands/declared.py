# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of commands: from their declarations in options/, and one that several have."""

from __future__ import annotations

from importlib import import_module
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional, TypeVar

import typer

from ..completion import complete_option
from .command import complete_open_list
from .path_words import accept_urls

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    from ...options.declare import Option

QuietOption = Annotated[bool, typer.Option('--quiet', '-q', help='Print only errors and losses')]
OverwriteOption = Annotated[bool, typer.Option('--overwrite', help='Replace what is at OUT')]
FsyncOption = Annotated[
    bool,
    typer.Option(
        '--fsync/--no-fsync',
        show_default=False,
        help='Wait until the output is on the disk, safe from a power cut [default: on]',
    ),
]
AllOverwriteOption = Annotated[
    bool, typer.Option('--overwrite', help='With --all: replace files in OUT')
]
JsonOption = Annotated[bool, typer.Option('--json', help='Print the result as JSON')]


def argument(name: str, help_text: str) -> Any:  # noqa: ANN401 - an argument of typer
    """Return an argument of a command, such as SRC."""
    return typer.Argument(metavar=name, help=help_text, autocompletion=complete_open_list)


def out_option(help_text: str, **rest: Any) -> Any:  # noqa: ANN401 - an option of typer
    """Return the option -o OUT; the rest are keywords of typer.Option."""
    return typer.Option('--out', '-o', metavar='OUT', help=help_text, **rest)


def choice(words: Collection[str], help_text: str) -> Any:  # noqa: ANN401 - an option of typer
    """Return an option that takes one of a few words."""
    complete = complete_option('', [*words])
    return typer.Option(metavar=_one_of(words), help=help_text, autocompletion=complete)


def _one_of(words: Iterable[str]) -> str:
    return f'[{"|".join(words)}]'


Marked = TypeVar('Marked', bound='Callable[..., object]')

_TABLES: dict[str, tuple[str, str, frozenset[str], list[Parameter]]] = {}
"""By name of a function: its table and its module, the options left out, its parameters."""


def takes(
    table: str, *, of: str = 'table', but: tuple[str, ...] = ()
) -> Callable[[Marked], Marked]:
    """Mark a command whose **given are the options of a table in options/.

    Args:
        table: Name of the table.
        of: Its module.
        but: Options that the command declares itself.
    """

    def mark(command: Marked) -> Marked:
        own = [
            each.replace(kind=Parameter.KEYWORD_ONLY)
            for each in signature(command, eval_str=True).parameters.values()
            if each.kind is not Parameter.VAR_KEYWORD
        ]
        _TABLES[command.__name__] = table, of, frozenset(but), own
        return _with_parameters(command, own)

    return mark


def add_options(command: Callable[..., object]) -> None:
    """Add the options of its table to the signature of a command, for typer to read.

    Only the command that runs needs them: `kitti-ros2 --help` does not import options/.
    """
    if command.__name__ not in _TABLES:
        _with_parameters(command, [*signature(command, eval_str=True).parameters.values()])
        return
    name, module, excluded, own = _TABLES[command.__name__]
    table = getattr(import_module(f'..options.{module}', __package__), name)
    declared = [_parameter(each) for each in table if each.name not in excluded]
    _with_parameters(command, [*own, *declared])


def _with_parameters(command: Marked, parameters: list[Parameter]) -> Marked:
    with_urls = [accept_urls(each) for each in parameters]
    command.__signature__ = Signature(with_urls)  # type: ignore[attr-defined]
    return command


def chosen(given: Mapping[str, object]) -> dict[str, object]:
    """Return the options that are given: those that are neither None nor an empty list."""
    return {name: value for name, value in given.items() if value is not None and value != []}


def _parameter(option: Option) -> Parameter:
    described = typer.Option(
        *_spellings(option),
        help=_help(option),
        metavar=_metavar(option),
        rich_help_panel=option.group or None,
        autocompletion=complete_option(option.name, option.choices),
    )
    kind: Any = Annotated[_kind(option), described]
    return Parameter(option.name, Parameter.KEYWORD_ONLY, default=None, annotation=kind)


def _kind(option: Option) -> Any:  # noqa: ANN401 - a type that typer knows
    from ...options import class_parsers, parsers, quantity_parsers

    kinds: dict[Any, Any] = {
        parsers.parse_flag: Optional[bool],
        parsers.parse_integer: Optional[int],
        parsers.parse_number: Optional[float],
        parsers.parse_path: Optional[Path],
        parsers.parse_texts: Optional[list[str]],
        quantity_parsers.parse_boxes: Optional[list[str]],
        class_parsers.parse_class_map: Optional[list[str]],
        class_parsers.parse_labels: Optional[list[str]],
        class_parsers.parse_class_overlaps: Optional[list[str]],
        parsers.parse_paths: Optional[list[str]],
        quantity_parsers.parse_shares: Optional[list[str]],
        class_parsers.parse_least_overlaps: Optional[list[str]],
    }
    return kinds.get(option.parse, Optional[str])


def _metavar(option: Option) -> str | None:
    """Return the placeholder of a value in help texts; None for a flag."""
    from ...options import parsers, quantity_parsers

    general: dict[Any, str] = {
        parsers.parse_integer: 'N',
        parsers.parse_number: 'X',
        parsers.parse_path: 'PATH',
        quantity_parsers.parse_seconds_ns: 'SECONDS',
        parsers.parse_texts: 'NAME...',
    }
    if option.choices and not option.metavar:
        return _one_of(option.choices)
    return option.metavar or general.get(option.parse)


def _spellings(option: Option) -> tuple[str, ...]:
    from ...options.parsers import parse_flag

    if any(flag.startswith('--') for flag in option.flags):
        return option.flags
    dashed = option.name.replace('_', '-')
    no = f'/--no-{dashed}' if option.parse is parse_flag else ''
    return (f'--{dashed}{no}', *option.flags)


def _help(option: Option) -> str:
    return option.meaning + (
        '' if option.default is False else f' [default: {option.default_text}]'
    )
