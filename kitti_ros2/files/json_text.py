# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Values as JSON text."""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ..model.losses import Loss


def json_text(values: object) -> str:
    """Return values as one JSON document; NaN and infinite numbers are null, paths are text."""
    return json.dumps(_finite(values), default=_json_value, indent=2) + '\n'


def losses_json(losses: Iterable[Loss]) -> list[dict[str, object]]:
    """Return losses with their texts, for json_text."""
    return [{'stream': each.stream, 'count': each.count, 'message': each.text()} for each in losses]


def _finite(value: Any) -> Any:  # noqa: ANN401 - any value of JSON
    """Return the value with null for NaN and infinite numbers, which JSON does not support."""
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def _json_value(value: object) -> str:
    if isinstance(value, Path):
        return str(value)
    raise TypeError(type(value))
