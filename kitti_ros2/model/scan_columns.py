# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The columns of a point in .bin scans: four in KITTI's files, others in those of other data sets.

Written as in `--columns 'x y z intensity - ring time:f8'`: names in the order of the file, - for a
column that is skipped, :f8 for float64 instead of float32; all little-endian.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from .errors import UsageError

if TYPE_CHECKING:
    import numpy as np

_COLUMN = re.compile(r'(-|[A-Za-z]\w{0,30})(?::(f[48]))?', re.ASCII)
_MOST = 64
_XYZ = ('x', 'y', 'z')
_REFLECTANCES = ('intensity', 'reflectance')
_OWN = frozenset({'label', 'instance', 'rgb', 'file_index'})
"""Fields that to-bag adds to clouds."""
REST = '_rest'
"""Ends the name of a field with what float32 cannot hold of a float64 column."""
SKIPPED = '-'


@dataclass(frozen=True)
class ScanColumns:
    """The columns of a point.

    Attributes:
        names: In the order of the file; - is skipped.
        kinds: Of each, f4 or f8.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> ScanColumns:
        """Parse the notation, with blanks or commas between columns.

        Raises:
            UsageError: A column is invalid or repeated, or x, y or z is missing.
        """
        words = text.replace(',', ' ').split()
        found = [_COLUMN.fullmatch(word) for word in words]
        wrong = [word for word, match in zip(words, found, strict=True) if match is None]
        if wrong or len(words) > _MOST:
            reason = f'{wrong[0]!r} is no column' if wrong else f'{len(words)} columns'
            raise UsageError(
                f'columns {text!r}: {reason}; expected up to {_MOST} names of columns such as'
                f' x y z intensity ring, - for one to skip, and :f8 behind float64'
            )
        columns = cls(
            tuple(match[1] for match in found if match),
            tuple(match[2] or 'f4' for match in found if match),
        )
        columns._check(text)
        return columns

    def _check(self, text: str) -> None:
        named = [_common(name) for name in self.names if name != SKIPPED]
        repeated = sorted({name for name in named if named.count(name) > 1})
        if repeated:
            raise UsageError(f'columns {text!r}: {repeated[0]} occurs twice')
        missing = [name for name in _XYZ if name not in named]
        if missing:
            raise UsageError(f'columns {text!r}: no {missing[0]}; expected x y z and others')
        own = sorted(name for name in named if name in _OWN or name.endswith(REST))
        if own:
            raise UsageError(f'columns {text!r}: to-bag has a field {own[0]}; choose another name')

    @property
    def text(self) -> str:
        """The notation."""
        pairs = zip(self.names, self.kinds, strict=True)
        return ' '.join(name + (f':{kind}' if kind != 'f4' else '') for name, kind in pairs)

    @cached_property
    def point(self) -> np.dtype[np.void]:
        """The structured type of a point; skipped columns have their number as name."""
        import numpy as np  # noqa: PLC0415 - help texts need none

        return np.dtype([
            (str(index) if name == SKIPPED else name, f'<{kind}')
            for index, (name, kind) in enumerate(zip(self.names, self.kinds, strict=True))
        ])  # fmt: skip

    @cached_property
    def kept(self) -> np.dtype[np.void]:
        """The structured type of a point without the skipped columns."""
        import numpy as np  # noqa: PLC0415 - as above

        pairs = zip(self.names, self.kinds, strict=True)
        return np.dtype([(name, f'<{kind}') for name, kind in pairs if name != SKIPPED])

    def kind_of(self, name: str) -> str:
        """Return the type of a named column: f4 or f8."""
        return self.kinds[self.names.index(name)]

    @property
    def point_bytes(self) -> int:
        """Bytes of a point in the file."""
        return sum(int(kind[1]) for kind in self.kinds)

    @property
    def is_kitti(self) -> bool:
        """Whether files are KITTI's own: float32 x y z reflectance."""
        return self.names[:3] == _XYZ and self.names[3:] in _KITTI and set(self.kinds) == {'f4'}

    @property
    def reflectance(self) -> str | None:
        """The name of the column with reflectance, None without one."""
        return next((name for name in self.names if name in _REFLECTANCES), None)

    @property
    def main(self) -> tuple[str, ...]:
        """The names of x, y, z, and of the reflectance if there is one."""
        return _XYZ if self.reflectance is None else (*_XYZ, self.reflectance)

    @property
    def extra(self) -> tuple[str, ...]:
        """The names of the other columns that are read, in their order."""
        return tuple(name for name in self.names if name not in {*self.main, SKIPPED})

    @property
    def skipped(self) -> tuple[int, ...]:
        """The positions of the skipped columns, from 1."""
        return tuple(at for at, name in enumerate(self.names, 1) if name == SKIPPED)

    def describe_skipped(self) -> str:
        """Describe the skipped columns, such as columns 5, 6 of 6."""
        noun = 'column' if len(self.skipped) == 1 else 'columns'
        return f'{noun} {", ".join(map(str, self.skipped))} of {len(self.names)}'


_KITTI = tuple((name,) for name in _REFLECTANCES)
KITTI_COLUMNS = ScanColumns((*_XYZ, 'intensity'), ('f4',) * 4)
"""Those of KITTI's files."""


def _common(name: str) -> str:
    return _REFLECTANCES[0] if name in _REFLECTANCES else name
