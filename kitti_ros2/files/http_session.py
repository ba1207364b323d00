# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The session of aiohttp by which fsspec asks web servers, which are not trusted.

The time-outs of aiohttp are of silence, or of a whole answer, which may be long. A server that
sends its header a byte at a time is never silent.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from aiohttp import ClientResponse, ClientSession

from ..model.errors import RemoteError, shown

if TYPE_CHECKING:
    from aiohttp.connector import Connection

_PLAIN = ('', 'identity')
_HEADERS_S = 20.0
"""Limit of all headers that one call of fsspec waits for: of HEAD, GET and their redirects."""
_LEFT_S: WeakKeyDictionary[object, float] = WeakKeyDictionary()
"""The rest of it, by the task of the call."""


async def open_session(**options: object) -> ClientSession:
    """Open a session; fsspec awaits it.

    Args:
        options: Options of fsspec and of its configuration.
    """
    kwargs: Any = options
    headers = dict(kwargs.get('headers') or {})
    others = {name: headers[name] for name in headers if name.lower() != 'accept-encoding'}
    kwargs['headers'] = {**others, 'Accept-Encoding': 'identity'}
    return ClientSession(**{**kwargs, 'response_class': _Response, 'auto_decompress': False})


class _Response(ClientResponse):
    """A response whose content is what was sent."""

    async def start(self, connection: Connection) -> ClientResponse:
        """Read the header.

        Raises:
            TimeoutError: It does not come in time.
            RemoteError: The content is compressed, and may be a million times as long as what is
                sent.
        """
        task, began = asyncio.current_task(), asyncio.get_running_loop().time()
        left_s = _LEFT_S.get(task, _HEADERS_S)
        try:
            await asyncio.wait_for(super().start(connection), left_s)
        finally:
            _LEFT_S[task] = left_s - asyncio.get_running_loop().time() + began
        coding = self.headers.get('Content-Encoding', '').strip()
        if self.method != 'HEAD' and 200 <= self.status < 300 and coding.lower() not in _PLAIN:
            url = str(self.url.with_user(None).with_query(None))
            what = f'the server compresses the file (Content-Encoding {shown(coding)})'
            raise RemoteError(url, f'{what}, which was not requested', 'download it')
        return self
