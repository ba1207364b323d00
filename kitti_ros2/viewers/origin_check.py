# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of web pages by the headers Origin and Host of a WebSocket handshake.

Browsers let any page connect to any WebSocket, also on loopback addresses; the server must check
the Origin, which pages cannot set (RFC 6455 section 10.2). A page whose name resolves to a loopback
address (DNS rebinding) is recognized by that name in Host.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import TypeAlias

from ..model.errors import UsageError

Address: TypeAlias = IPv4Address | IPv6Address

KNOWN_ORIGINS = frozenset({'https://app.foxglove.dev', 'https://studio.foxglove.dev', 'file://'})
"""Origins of viewers that other machines serve.

Foxglove in a browser, today (the SDK's WebSocketServer.app_url) and before 2024
(https://github.com/foxglove/studio). Desktop applications such as Lichtblick's are pages of a local
file (packages/suite-desktop/src/main/StudioWindow.ts of
https://github.com/lichtblick-suite/lichtblick). Users host Lichtblick for browsers themselves, by
default at http://localhost:8080; pages of this machine are accepted anyway.
"""

_ORIGIN = re.compile(r'(?P<scheme>[a-z][a-z0-9+.-]*)://(?P<host>\[[0-9a-f:.]+\]|[^/\s:@]*)(:\d+)?')
_HOST = re.compile(r'(?P<host>\[[0-9a-f:.]+\]|[^/\s:@]+)(:\d*)?')
_WEB = ('http', 'https')
_SHOWN = 100


def parse_origin(text: str) -> str:
    """Return the origin in an option, as browsers write it.

    Raises:
        UsageError: It is not scheme://host or scheme://host:port.
    """
    origin = text.lower()
    if not origin.endswith('://'):
        origin = origin.removesuffix('/')
    if not _ORIGIN.fullmatch(origin):
        raise UsageError(
            f'--allow-origin takes scheme://host or scheme://host:port, such as'
            f' https://viewer.example.org, not {text!r}'
        )
    return origin


@dataclass(frozen=True)
class OriginCheck:
    """Decides about handshakes.

    Args:
        bound: Requested address of the server: a name or an IP address.
        allowed: More origins, as parse_origin returns them.
    """

    bound: str
    allowed: frozenset[str] = frozenset()

    def refusal(self, host: str, origin: str | None, local: str) -> str | None:
        """Return the reason for refusing a handshake, with the option that accepts it.

        Args:
            host: Header Host.
            origin: Header Origin; None without one, as of programs other than browsers.
            local: Address of this machine that the client is connected to.

        Returns:
            A line; None for an accepted handshake.
        """
        if not self._is_ours(host, local):
            return (
                f'the host name {shown(host)} is not a name of this machine; to accept it:'
                f' --allow-origin http://{shown(host)}'
            )
        if origin is not None and not self._is_known(origin):
            return f'pages of {shown(origin)} may not connect; to accept them: {_remedy(origin)}'
        return None

    def _is_known(self, origin: str) -> bool:
        text = origin.lower()
        if text in KNOWN_ORIGINS or text in self.allowed:
            return True
        match = _ORIGIN.fullmatch(text)
        return match is not None and match['scheme'] in _WEB and is_loopback(match['host'])

    def _is_ours(self, host: str, local: str) -> bool:
        match = _HOST.fullmatch(host.lower())
        if match is None:
            return False
        name = match['host']
        if is_loopback(name) or name == self.bound.lower() or name in self._allowed_hosts():
            return True
        address, bound = _address(name), _address(self.bound)
        if address is None:
            return False
        # Rebinding needs a name: the user typed an address in Host. With all addresses bound, a
        # router or a container may translate it to this machine's.
        if bound is not None and bound.is_unspecified:
            return True
        return address in {bound, _address(local)}

    def _allowed_hosts(self) -> set[str]:
        matches = (_ORIGIN.fullmatch(origin) for origin in self.allowed)
        return {match['host'] for match in matches if match}


def is_loopback(host: str) -> bool:
    """Return whether a name or an address, IPv6 also in brackets, is this machine's loopback.

    Names under localhost resolve to this machine (RFC 6761 section 6.3).
    """
    name = host.lower().removesuffix('.')
    if name == 'localhost' or name.endswith('.localhost'):
        return True
    address = _address(name)
    return address is not None and address.is_loopback


def exposure(host: str, url: str) -> str | None:
    """Return a warning for a server that other machines can reach; None for loopback."""
    if is_loopback(host):
        return None
    return (
        f'{shown(host)} is not a loopback address: everyone in its network can watch and control'
        f' the playback at {url}, without a password and without encryption'
    )


def _address(text: str) -> Address | None:
    try:
        address = ip_address(text.strip('[]').partition('%')[0])
    except ValueError:
        return None
    return getattr(address, 'ipv4_mapped', None) or address


def _remedy(origin: str) -> str:
    if _ORIGIN.fullmatch(origin.lower()):
        return f'--allow-origin {shown(origin)}'
    return 'open the viewer from an address of its own, and give it to --allow-origin'


def shown(text: str) -> str:
    """Return a client's text for a line of output: printable and short."""
    printable = ''.join(char if char.isprintable() else '?' for char in text)
    return printable if len(printable) <= _SHOWN else f'{printable[:_SHOWN]}...'
