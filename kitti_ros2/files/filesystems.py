# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""fsspec's file systems, by the URLs of their files."""

from __future__ import annotations

import os
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

from ..model.errors import UsageError

if TYPE_CHECKING:
    from .url_path import UrlPath

FileSystem: TypeAlias = Any
"""fsspec's AbstractFileSystem, which has no types."""

_PACKAGES = {'gs': 'gcsfs', 'gcs': 'gcsfs', 'abfs': 'adlfs', 'az': 'adlfs', 'sftp': 'paramiko'}
"""Of schemes that the extra does not install."""


def filesystem_of(path: UrlPath) -> FileSystem:
    """Return fsspec's file system of a path, the same for all paths of one store.

    Raises:
        UsageError: A package is missing, or the scheme is unknown.
    """
    return _filesystem(path.scheme, path.names[0] if path.names else '', os.getpid())


@lru_cache(maxsize=64)
def _filesystem(scheme: str, host: str, process: int) -> FileSystem:  # noqa: ARG001 - not shared
    place = f'{scheme}://{host}'
    try:
        from fsspec.core import url_to_fs  # noqa: PLC0415 - for URLs only
        from fsspec.registry import known_implementations, registry  # noqa: PLC0415 - as above
    except ImportError:
        raise UsageError(
            f'{place}: URLs need fsspec, which is not installed; run pip install'
            f" 'kitti_ros2[remote]'"
        ) from None
    if scheme not in known_implementations and scheme not in registry:
        raise UsageError(f'{place}: unknown scheme {scheme}://; known are s3, gs, http and https')
    try:
        return url_to_fs(place, **_options(scheme))[0]
    except ImportError as error:
        package = _PACKAGES.get(scheme)
        install = f'pip install {package}' if package else "pip install 'kitti_ros2[remote]'"
        reason = ' '.join(str(error).split())
        raise UsageError(f'{place}: needs a package, run {install} ({reason})') from None


def _options(scheme: str) -> dict[str, Any]:
    """Return the options of a file system.

    Raises:
        ImportError: A package is missing.
    """
    if scheme not in {'http', 'https'}:
        return {}
    from .http_session import open_session  # noqa: PLC0415 - it needs aiohttp

    return {'get_client': open_session}


def key_of(path: UrlPath) -> str:
    """Return the name that the methods of fsspec's file system take."""
    return str(filesystem_of(path)._strip_protocol(path.whole))  # noqa: SLF001 - fsspec's own way
