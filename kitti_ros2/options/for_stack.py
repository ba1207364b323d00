# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options that a stack needs, for --for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..model.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..stacks.stack import Setting, Value
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
        chosen = applied(setting, options)
        if chosen is None:
            continue
        option, values = options[chosen[0]], chosen[1]
        accepted = [option.parse(option.name, value) for value in values]
        given = found.setdefault(option.name, accepted[0])
        if given not in accepted:
            needed = ' or '.join(_word(value) for value in values)
            raise UsageError(
                f'{name.value} needs {option.name} {needed}, not {_word(option.plain(given))};'
                f' leave out one of --for and --{option.name.replace("_", "-")}'
            )
    return found


def applied(
    setting: Setting, options: Mapping[str, Option]
) -> tuple[str, tuple[Value, ...]] | None:
    """Return the option of a setting and the values that it may have, the chosen one first.

    None if neither the option nor the one that stands in for it is among the options.
    """
    if setting.name in options:
        return setting.name, (setting.value, *setting.others)
    if setting.instead is not None and setting.instead[0] in options:
        return setting.instead[0], setting.instead[1:]
    return None


def _word(value: object) -> str:
    return {True: 'on', False: 'off'}[value] if isinstance(value, bool) else str(value)
