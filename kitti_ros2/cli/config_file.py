# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of the YAML file of --config."""

from __future__ import annotations

from typing import TYPE_CHECKING

import yaml

from ..model.errors import UsageError
from ..options.declare import check_names

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from pathlib import Path

    from ..options.declare import Option

_KEPT_AS_TEXT = {'int', 'timestamp'}


def load_config(path: Path, known: Collection[str]) -> dict[str, object]:
    """Read the options of a YAML file, a mapping of names to values.

    Args:
        path: The file.
        known: The valid names.

    Raises:
        UsageError: The file is missing, invalid YAML, or not a mapping of known names.
    """
    try:
        values = yaml.load(path.read_text('utf-8'), _text_loader())  # noqa: S506 - a safe loader
    except OSError as error:
        raise UsageError(f'{path}: {error.strerror}; --config takes a YAML file') from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, 'problem_mark', None)
        where = f'{path}:{mark.line + 1}' if mark is not None else str(path)
        problem = getattr(error, 'problem', None) or 'not UTF-8'
        raise UsageError(
            f'{where}: invalid YAML, {problem}; expected lines like "images: raw"'
        ) from None
    if values is None:
        return {}
    if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
        raise UsageError(f'{path}: not a mapping; expected lines like "images: raw"')
    check_names(values, known, f'{path}: ')
    return values


def add_config(
    config: Path, given: Mapping[str, object], declared: Sequence[Option]
) -> dict[str, object]:
    """Add the options of a YAML file to those of the command line, which win.

    With a stack, a default in the file is not given: a file may list all options.

    Raises:
        UsageError: See load_config.
    """
    of_file = load_config(config, [each.name for each in declared])
    if {**of_file, **given}.get('stack') is not None:
        plain = {each.name: each.plain(each.default) for each in declared}
        of_file = {name: value for name, value in of_file.items() if value != plain[name]}
    return {name: value for name, value in of_file.items() if value is not None} | dict(given)


def _text_loader() -> type[yaml.SafeLoader]:
    """Return a safe loader that keeps whole numbers and times as text.

    YAML reads 0010 as 8 and truncates a stamp to microseconds.
    """

    class Loader(yaml.SafeLoader):
        yaml_implicit_resolvers = {  # noqa: RUF012 - as the base class has it
            first: [item for item in items if item[0].rsplit(':', 1)[-1] not in _KEPT_AS_TEXT]
            for first, items in yaml.SafeLoader.yaml_implicit_resolvers.items()
        }

    return Loader
