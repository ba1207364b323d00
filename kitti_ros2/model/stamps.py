# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Time stamps as integer nanoseconds since 1970-01-01 UTC, and their text forms.

KITTI writes ``2011-09-26 13:02:25.951199337`` (raw, nine digits, read as UTC) and relative seconds
such as ``1.037359e-01`` (odometry). Nothing here passes through float or datetime microseconds:
float64 resolves 2011 only to 238 ns.
"""

from __future__ import annotations

import re
from datetime import datetime, timedelta, timezone
from functools import lru_cache

NS_PER_S = 1_000_000_000
LAST_NS = 2**31 * NS_PER_S - 1
"""The latest value of builtin_interfaces/Time, in 2038: its seconds are an int32."""

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_SECOND = re.compile(r'(\d{4})-(\d{2})-(\d{2})[ T](\d{2}):(\d{2}):(\d{2})', re.ASCII)
_DIGITS = 9


def parse_stamp(text: str) -> int:
    """Parse a KITTI time stamp into nanoseconds, ``YYYY-MM-DD HH:MM:SS[.fraction]``, taken as UTC.

    Raises:
        ValueError: The text is no such stamp, the date does not exist, or ROS 2 cannot represent it
            (before 1970 or after January 2038).
    """
    whole, point, fraction = text.rstrip(' \t\r\n\v\f').partition('.')
    if point and not (fraction.isascii() and fraction.isdecimal() and len(fraction) <= _DIGITS):
        raise ValueError(f'{text.strip()!r} is no time stamp')
    stamp_ns = _second_ns(whole) + int(fraction.ljust(_DIGITS, '0'))
    if not 0 <= stamp_ns <= LAST_NS:
        raise ValueError(f'{text.strip()!r} is not within 1970 to 2038, all that ROS 2 can hold')
    return stamp_ns


@lru_cache(maxsize=16)  # stamps are in order, ten a second in each stream
def _second_ns(text: str) -> int:
    """Return the nanoseconds of a whole second."""
    match = _SECOND.fullmatch(text)
    if match is None:
        raise ValueError(f'{text.strip()!r} is no time stamp')
    year, month, day, hour, minute, second = map(int, match.groups())
    moment = datetime(year, month, day, hour, minute, second, tzinfo=timezone.utc)
    return (moment - _EPOCH) // timedelta(seconds=1) * NS_PER_S


def format_stamp(stamp_ns: int) -> str:
    """Format a stamp as KITTI does, with all nine digits; the inverse of parse_stamp."""
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    moment = _EPOCH + timedelta(seconds=seconds)
    return f'{moment:%Y-%m-%d %H:%M:%S}.{nanoseconds:09d}'


def parse_seconds(text: str) -> int:
    """Parse decimal seconds (odometry's times.txt) into nanoseconds, rounded to the nearest.

    Raises:
        ValueError: The text is no finite number.
    """
    from decimal import Decimal, InvalidOperation  # noqa: PLC0415 - 3 ms of any start

    try:
        seconds = Decimal(text.strip())
    except InvalidOperation:
        raise ValueError(f'{text.strip()!r} is no number of seconds') from None
    if not seconds.is_finite():
        raise ValueError(f'{text.strip()!r} is no finite number of seconds')
    if not 0 <= seconds <= LAST_NS // NS_PER_S:
        raise ValueError(f'{text.strip()!r} is no number of seconds that ROS 2 can hold')
    return int((seconds * NS_PER_S).to_integral_value())


def format_seconds(offset_ns: int) -> str:
    """Format an offset as in odometry's times.txt: seconds, six decimals of mantissa."""
    return f'{offset_ns / NS_PER_S:.6e}'


def to_sec_nanosec(stamp_ns: int) -> tuple[int, int]:
    """Return (sec, nanosec) of builtin_interfaces/Time; 0 <= nanosec < 1e9 for every stamp."""
    return divmod(stamp_ns, NS_PER_S)


def from_sec_nanosec(sec: int, nanosec: int) -> int:
    """Return nanoseconds; the inverse of to_sec_nanosec."""
    return sec * NS_PER_S + nanosec
