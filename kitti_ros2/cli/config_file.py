# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of the YAML file of --config."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.errors import BadFileError, UsageError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence
    from pathlib import Path

    from ..options.declare import Option

# YAML reads 0010 as 8 and truncates a stamp to microseconds.
_KEPT_AS_TEXT = ('int', 'timestamp')


def load_config(path: Path, known: Collection[str]) -> dict[str, object]:
    """Read the options of a YAML file, a mapping of names to values.

    Args:
        path: The file.
        known: The valid names.

    Raises:
        UsageError: The file is missing, invalid YAML, or not a mapping of known names.
    """
    from ..kitti.store import STORE
    from ..model.yaml_text import YamlTextError, load_yaml
    from ..options.declare import check_names

    try:
        values = load_yaml(STORE.read_text(path), _KEPT_AS_TEXT)
    except OSError as error:
        raise UsageError(f'{path}: {error.strerror}; --config takes a YAML file') from None
    except BadFileError as error:
        raise UsageError(f'{error}; --config takes a YAML file') from None
    except YamlTextError as error:
        where = path if error.line is None else f'{path}:{error.line}'
        raise UsageError(
            f'{where}: invalid YAML, {error.problem}; expected lines like "images: raw"'
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
