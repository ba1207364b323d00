# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of sub-commands: declarations, YAML files, parsing, help texts."""

from __future__ import annotations

import re
from contextlib import contextmanager
from functools import lru_cache, wraps
from importlib import import_module
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Optional,
    TypeVar,
    cast,
    get_args,
    get_origin,
)

import typer
from typer.core import TyperCommand, TyperOption
from typer.main import get_click_type

from ..model.errors import BadFileError, UsageError
from .completion import complete_option
from .given_words import GivenWords, out_last, rename

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from ..options.declare import Option


# A sub-command: help with options in groups and examples, several values after one option.

_SPECIAL = re.compile(r'[^\w ,.:()/*-]')
_EXAMPLES = '\n\nExamples:\n'
_MOST_OPTIONS = 12
_ALL_OPTIONS = 'kitti_ros2.all_options'
CONFIG_ONLY = 'In the file of --config'
"""Heading of options that belong into that file, by name."""
_LISTS = (
    '{lists} takes all words up to the next option or --. Give {arguments} before it, after --, or'
    ' as its last words.'
)
_OUT_ARGUMENTS = ('OUT', 'ROOT')
OPEN_LIST = 'kitti_ros2.open_list'
"""Key of a context's meta: the option whose list of values the last word belongs to."""


def complete_open_list(ctx: Any, incomplete: str) -> list[str]:  # noqa: ANN401 - typer's context
    """Complete a word that stands where an argument may, but belongs to a list of values."""
    option = ctx.meta.get(OPEN_LIST)
    if option is None:
        return []
    return [completion.value for completion in option.shell_complete(ctx, incomplete)]


class Command(TyperCommand):
    """A command whose help is its docstring: a summary, an explanation, and Examples:."""

    def __init__(self, *args: Any, **rest: Any) -> None:  # noqa: ANN401 - those of the base class
        super().__init__(*args, **rest)
        text, _, examples = (self.help or '').partition(_EXAMPLES)
        self.help: str = text
        self.examples = examples
        self._help_all = TyperOption(
            param_decls=['--help-all'],
            is_flag=True,
            is_eager=True,
            expose_value=False,
            hidden=True,  # the last line of the options names it
            callback=self._print_all,
        )

    def get_params(self, ctx: Any) -> list[Any]:  # noqa: ANN401 - as above
        """Return arguments and options, those about help last."""
        return [*super().get_params(ctx), self._help_all]

    def _print_all(self, ctx: Any, _: object, asked: object) -> None:  # noqa: ANN401 - as above
        if asked and not ctx.resilient_parsing:
            ctx.meta[_ALL_OPTIONS] = True
            typer.echo(self.get_help(ctx))
            ctx.exit()

    def get_short_help_str(self, limit: int = 45) -> str:  # noqa: ARG002 - click's form
        """Return the first line, whole."""
        return self.help.partition('\n')[0]

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ANN401, ARG002 - click's form
        """Return the words of the usage line: arguments as help texts write them."""
        names = [arg.metavar if arg.required else f'[{arg.metavar}]' for arg in self._arguments]
        return ['[OPTIONS]', *names, *(['[OUT]'] if self._out else [])]

    def format_help(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - as above
        """Write the help as plain text, in old versions of typer too."""
        self.format_usage(ctx, formatter)
        self.format_help_text(ctx, formatter)
        self.format_options(ctx, formatter)
        self.format_epilog(ctx, formatter)

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - as above
        """Write arguments and options, by group, or the common ones of many without headings."""
        rows = [(arg.metavar, arg.help or '') for arg in self._arguments]
        if self._out is not None:
            rows.append(('OUT, -o OUT', self._out.help))
        if rows:
            with formatter.section('Arguments'):
                formatter.write_dl(rows)
        total = len(self.params) - len(rows)
        if ctx.meta.get(_ALL_OPTIONS) or total <= _MOST_OPTIONS:
            with self._unhidden():
                sections = self._records(ctx, self.get_params(ctx))
            _write_sections(formatter, sections)
            return
        common = [row for rows in self._records(ctx, self.params).values() for row in rows]
        _write_sections(formatter, {'Options': common})
        formatter.write_paragraph()
        formatter.write_text(
            f'These are {len(common)} of {total} options; {ctx.command_path} --help-all shows all.'
        )

    def _records(self, ctx: Any, params: list[Any]) -> dict[str, list[tuple[str, str]]]:  # noqa: ANN401
        """Return the rows of options that are not hidden, by group; those without one last."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for param in params:
            record = param.get_help_record(ctx)
            if param.param_type_name == 'option' and record and param is not self._out:
                if _group(param) == CONFIG_ONLY:
                    record = param.name, record[1]
                groups.setdefault(_group(param), []).append(record)
        groups['Options'] = groups.pop('', [])
        return groups

    @contextmanager
    def _unhidden(self) -> Iterator[None]:
        """Show all options, of this command alone: it is kept for further command lines."""
        params: Sequence[Any] = self.params
        hidden = [param for param in params if getattr(param, 'hidden', False)]
        for param in hidden:
            param.hidden = False
        try:
            yield
        finally:
            for param in hidden:
                param.hidden = True

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - as above
        """Write the rule of options with several values, and the examples as they are."""
        lists = [option.metavar for option in self._lists(ctx).values() if not option.hidden]
        if lists:
            formatter.write_paragraph()
            names = ' and '.join(arg.metavar for arg in self._arguments)
            formatter.write_text(_LISTS.format(lists=lists[0], arguments=names))
        if self.examples:
            formatter.write_paragraph()
            formatter.write(f'Examples:\n{self.examples}\n')

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - as above
        """Parse, after repeating options with several values before each of them."""
        lists = self._lists(ctx)
        valued = {
            flag
            for param in self.get_params(ctx)
            if not getattr(param, 'is_flag', True)
            for flag in param.opts
        }
        flags = {flag for param in self.params for flag in param.opts}
        args, notes = rename(args, self.name or '', flags, valued - {*lists})
        self._say_notes(ctx, args, notes)
        if self._arguments and self._arguments[-1].metavar.endswith(_OUT_ARGUMENTS):
            args = out_last(args)
        words = GivenWords(args, lists, valued)
        if ctx.resilient_parsing:  # for a completion
            ctx.meta[OPEN_LIST] = words.open_list
            args = words.spread()
            if args and args[-1] in valued:
                args.pop()  # an option without its value would hide the arguments
        else:
            words.take_arguments([arg.metavar for arg in self._arguments])
            if self._out is not None:
                words.option_of_out(self._out.opts[0], len(self._arguments))
            args = words.spread()
        parsed: list[str] = super().parse_args(ctx, args)
        self._say_notes(ctx, args, [
            f'{param.opts[0]} has its place in the file of --config, as {param.name}; the next'
            f' release does not take it here'
            for param in self.params
            if _group(param) == CONFIG_ONLY and ctx.params.get(param.name) is not None
        ])  # fmt: skip
        return parsed

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - as above
        """Run the command; a folder that was made for OUT is named, as it may be a misspelt one."""
        folder = _missing_folder(self._out_of(ctx.params))
        code = super().invoke(ctx)
        if folder is not None and folder.exists() and not ctx.params.get('quiet'):
            typer.echo(f'note: the folder {folder} was not there; it is made for OUT', err=True)
        return code

    def _out_of(self, params: Mapping[str, Any]) -> Path | None:
        """Return the path of OUT, as far as it is given."""
        last = self._arguments[-1] if self._arguments else None
        if last is None or not last.metavar.endswith(_OUT_ARGUMENTS):
            return params.get('out')
        value = params[last.name] or None
        return value[-1] if isinstance(value, (list, tuple)) else value

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:  # noqa: ANN401 - as above
        """Complete a value of a list, or an option with plain help."""
        option = ctx.meta.get(OPEN_LIST)
        if option is not None and not incomplete.startswith('-'):
            completions: list[Any] = option.shell_complete(ctx, incomplete)
            return completions
        with self._unhidden():
            completions = super().shell_complete(ctx, incomplete)
        for completion in completions:
            completion.help = _SPECIAL.sub('', (completion.help or '').partition(' [default')[0])
        return completions

    @staticmethod
    def _say_notes(ctx: Any, words: Sequence[str], notes: Sequence[str]) -> None:  # noqa: ANN401
        is_first = ctx.parent is not None  # else it is parsed again, for the text of an error
        if is_first and not ctx.resilient_parsing and not {'-q', '--quiet'} & {*words}:
            for note in notes:
                typer.echo(f'note: {note}', err=True)

    @property
    def _arguments(self) -> list[Any]:
        return [param for param in self.params if param.param_type_name == 'argument']

    @property
    def _out(self) -> Any:  # noqa: ANN401 - an option of typer's copy of click
        """The option of OUT that may be the last argument, too; None if there is none."""
        if any(arg.nargs < 0 for arg in self._arguments):
            return None  # OUT would be one of PATH...
        return next((param for param in self.params if '--out' in param.opts), None)

    def _lists(self, ctx: Any) -> dict[str, Any]:  # noqa: ANN401 - as above
        """Return the options with several values, by spelling."""
        params = [param for param in self.get_params(ctx) if getattr(param, 'multiple', False)]
        return {flag: param for param in params for flag in param.opts}


def _missing_folder(out: Path | None) -> Path | None:
    """Return the topmost folder that is missing above a path of this machine; None if none is."""
    if out is None or '://' in str(out):
        return None
    return next((path for path in reversed(Path(out).parents) if not path.exists()), None)


def _write_sections(formatter: Any, sections: Mapping[str, Any]) -> None:  # noqa: ANN401 - as above
    for title, records in sections.items():
        with formatter.section(title):
            formatter.write_dl(records)


def _group(param: Any) -> str:  # noqa: ANN401 - as above
    return getattr(param, 'rich_help_panel', None) or ''


# Words of the command line that are paths or URLs.


class _PathWord:
    """Type in place of Path: typer would make a Path of a URL, without its `//`."""


_KINDS: tuple[tuple[Any, Any], ...] = (
    (Path, _PathWord),
    (Optional[Path], Optional[_PathWord]),
    (list[Path], list[_PathWord]),
    (Optional[list[Path]], Optional[list[_PathWord]]),
)


def accept_urls(parameter: Parameter) -> Parameter:
    """Return a parameter of a command that takes URLs, too, if it takes a path."""
    if get_origin(parameter.annotation) is not Annotated:
        return parameter
    kind, described = get_args(parameter.annotation)
    stand_in = next((other for path_kind, other in _KINDS if kind == path_kind), None)
    if stand_in is None:
        return parameter
    described.click_type = _path_or_url()
    return parameter.replace(annotation=Annotated[stand_in, described])


@lru_cache(maxsize=1)
def _path_or_url() -> Any:  # noqa: ANN401 - a type of typer's copy of click
    base: Any = type(get_click_type(annotation=Path, parameter_info=typer.Argument()))

    class PathOrUrl(base):  # type: ignore[misc]
        """A path, completed as paths are, or a URL."""

        def convert(self, value: Any, param: Any, ctx: Any) -> Path:  # noqa: ANN401, ARG002 - click's form
            from ..files.remote import as_path

            return as_path(value)

    return PathOrUrl()


# Options of commands: from their declarations in options/, and those that several share.

QuietOption = Annotated[
    bool, typer.Option('--quiet', '-q', hidden=True, help='Print only errors and losses')
]
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
JsonOption = Annotated[bool, typer.Option('--json', hidden=True, help='Print the result as JSON')]


def argument(name: str, help_text: str) -> Any:  # noqa: ANN401 - an argument of typer
    """Return an argument of a command, such as SRC."""
    return typer.Argument(metavar=name, help=help_text, autocompletion=complete_open_list)


def out_option(help_text: str, **rest: Any) -> Any:  # noqa: ANN401 - an option of typer
    """Return the option -o OUT; the rest are keywords of typer.Option."""
    return typer.Option('--out', '-o', metavar='OUT', help=help_text, **rest)


def choice(words: Collection[str], help_text: str) -> Any:  # noqa: ANN401 - an option of typer
    """Return an option that takes one of a few words."""
    complete = complete_option('', [*words])
    return typer.Option(metavar=f'[{"|".join(words)}]', help=help_text, autocompletion=complete)


Marked = TypeVar('Marked', bound='Callable[..., object]')

_TABLES: dict[str, tuple[str, str, frozenset[str], list[Parameter]]] = {}
"""Table, its module, the options left out and own parameters, by name of a function."""


def takes(
    table: str, *, of: str = 'table', but: tuple[str, ...] = ()
) -> Callable[[Marked], Marked]:
    """Mark a command whose **given are the options of a table in options/, as far as given.

    Args:
        table: Name of the table.
        of: Module of the table.
        but: Options that the command declares itself.
    """

    def mark(command: Marked) -> Marked:
        own = [
            parameter.replace(kind=Parameter.KEYWORD_ONLY)
            for parameter in signature(command, eval_str=True).parameters.values()
            if parameter.kind is not Parameter.VAR_KEYWORD
        ]

        @wraps(command)
        def run(*values: object, **given: object) -> object:
            return command(*values, **_given(given))

        _TABLES[command.__name__] = table, of, frozenset(but), own
        return cast('Marked', _with_parameters(run, own))

    return mark


def _given(values: Mapping[str, object]) -> dict[str, object]:
    """Return the options that are given: those that are neither None nor an empty list."""
    return {name: value for name, value in values.items() if value is not None and value != []}


def add_options(command: Callable[..., object]) -> None:
    """Add the options of its table to the signature of a command, for typer to read.

    Only the command that runs needs them: `kitti-ros2 --help` does not import options/.
    """
    if command.__name__ not in _TABLES:
        _with_parameters(command, [*signature(command, eval_str=True).parameters.values()])
        return
    name, module, excluded, own = _TABLES[command.__name__]
    table = getattr(import_module(f'..options.{module}', __package__), name)
    declared = [_parameter(option) for option in table if option.name not in excluded]
    _with_parameters(command, [*own, *declared])


def _with_parameters(command: Marked, parameters: list[Parameter]) -> Marked:
    with_urls = [accept_urls(parameter) for parameter in parameters]
    command.__signature__ = Signature(with_urls)  # type: ignore[attr-defined]
    return command


def _parameter(option: Option) -> Parameter:
    described = typer.Option(
        *_spellings(option),
        help=_help(option),
        metavar=option.placeholder or None,
        rich_help_panel=CONFIG_ONLY if option.config_only else option.group or None,
        hidden=not option.common,
        autocompletion=complete_option(option.name, option.choices),
    )
    kind: Any = Annotated[Optional[option.kind], described]
    return Parameter(option.name, Parameter.KEYWORD_ONLY, default=None, annotation=kind)


def _spellings(option: Option) -> tuple[str, ...]:
    if any(flag.startswith('--') for flag in option.flags):
        return option.flags
    dashed = option.name.replace('_', '-')
    no = f'/--no-{dashed}' if option.kind is bool else ''
    return (f'--{dashed}{no}', *option.flags)


def _help(option: Option) -> str:
    return option.meaning + (
        '' if option.default is False else f' [default: {option.default_text}]'
    )


# Reader of the YAML file of --config.


# YAML reads 0010 as 8 and truncates a stamp to microseconds.
_TAGS_AS_TEXT = ('int', 'timestamp')


def load_config(path: Path, names: Collection[str]) -> dict[str, object]:
    """Read the options of a YAML file, a mapping of names to values.

    Args:
        path: The file.
        names: The valid names.

    Raises:
        UsageError: The file is missing, invalid YAML, or not a mapping of known names.
    """
    from ..kitti.store import STORE
    from ..model.yaml_text import YamlTextError, load_yaml
    from ..options.declare import check_names

    try:
        values = load_yaml(STORE.read_text(path), _TAGS_AS_TEXT)
    except OSError as error:
        raise UsageError(f'{path}: {error.strerror}; --config takes a YAML file') from None
    except BadFileError as error:
        raise UsageError(f'{error}; --config takes a YAML file') from None
    except YamlTextError as error:
        location = path if error.line is None else f'{path}:{error.line}'
        raise UsageError(
            f'{location}: invalid YAML, {error.problem}; expected lines like "images: raw"'
        ) from None
    if values is None:
        return {}
    if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
        raise UsageError(f'{path}: not a mapping; expected lines like "images: raw"')
    check_names(values, names, f'{path}: ')
    return values


def add_config(
    config: Path, given: Mapping[str, object], declared: Sequence[Option]
) -> dict[str, object]:
    """Add the options of a YAML file to those of the command line, which win.

    With a stack, a default in the file is not given: a file may list all options.

    Raises:
        UsageError: See load_config.
    """
    of_file = load_config(config, [option.name for option in declared])
    if {**of_file, **given}.get('stack') is not None:
        plain = {option.name: option.plain(option.default) for option in declared}
        of_file = {name: value for name, value in of_file.items() if value != plain[name]}
    return {name: value for name, value in of_file.items() if value is not None} | dict(given)
