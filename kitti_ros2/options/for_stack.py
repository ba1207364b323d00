# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options that a stack needs, for --for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..model.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from .declare import Option


def with_stack(parsed: Mapping[str, Any], declared: Sequence[Option]) -> dict[str, Any]:
    """Add the options that the stack of a command needs to those that are given.

    Args:
        parsed: Parsed values by name of option, without defaults.
        declared: The options of the command.

    Raises:
        UsageError: A given value does not meet the demands of the stack.
    """
    name = parsed.get('stack')
    if name is None:
        return dict(parsed)
    from ..stacks.catalogue import STACKS  # noqa: PLC0415 - for --for only

    found = dict(parsed)
    options = {each.name: each for each in declared}
    for setting in STACKS[name.value].settings:
        option, values = options[setting.name], (setting.value, *setting.others)
        accepted = [option.parse(option.name, value) for value in values]
        given = found.setdefault(option.name, accepted[0])
        if given not in accepted:
            needed = ' or '.join(_word(value) for value in values)
            raise UsageError(
                f'{name.value} needs {option.name} {needed}, not {_word(option.plain(given))};'
                f' leave out one of --for and --{option.name.replace("_", "-")}'
            )
    return found


def _word(value: object) -> str:
    return {True: 'on', False: 'off'}[value] if isinstance(value, bool) else str(value)
