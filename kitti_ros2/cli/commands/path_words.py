# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Words of the command line that are paths or URLs."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional, get_args, get_origin

import typer
from typer.main import get_click_type

if TYPE_CHECKING:
    from inspect import Parameter


class _PathWord:
    """Stands for Path, of which typer would make one of URLs, too, without their `//`."""


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
    stand_in = next((other for known, other in _KINDS if kind == known), None)
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
            from ...files.remote import as_path

            return as_path(value)

    return PathOrUrl()
