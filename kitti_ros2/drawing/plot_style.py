# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The style of plots, and the files that they are drawn to."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from warnings import catch_warnings, simplefilter

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from matplotlib.figure import Figure

INK = '#30343b'
_STYLE: dict[str, Any] = {
    'axes.axisbelow': True,
    'axes.edgecolor': INK,
    'axes.grid': True,
    'axes.labelcolor': INK,
    'axes.linewidth': 0.6,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.titlesize': 9,
    'axes.titleweight': 'bold',
    'font.size': 7.5,
    'grid.color': '#e4e6ea',
    'grid.linewidth': 0.6,
    'legend.frameon': False,
    'legend.fontsize': 7,
    'svg.hashsalt': 'kitti_ros2',
    'text.color': INK,
    'text.parse_math': False,  # names of classes may hold any characters
    'xtick.color': INK,
    'ytick.color': INK,
}
"""For matplotlib's rc_context."""

_DPI = 200


@contextmanager
def plot_file(path: Path, inches: tuple[float, float], h_pad: float = 0.06) -> Iterator[Figure]:
    """Yield a figure that is written at the end.

    Args:
        path: The picture: .png, .pdf or .svg.
        inches: Width and height.
        h_pad: Above and below each panel, inches.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: The file cannot be written.
    """
    from matplotlib import rc_context  # noqa: PLC0415 - heavy, and an extra
    from matplotlib.figure import Figure  # noqa: PLC0415 - as above
    from matplotlib.layout_engine import ConstrainedLayoutEngine  # noqa: PLC0415 - as above

    with rc_context(_STYLE), catch_warnings():
        simplefilter('ignore')  # characters that the font does not have are drawn as boxes
        layout = ConstrainedLayoutEngine(w_pad=0.06, h_pad=h_pad, hspace=0.02, wspace=0.02)
        figure = Figure(inches, layout=layout)
        yield figure
        figure.savefig(path, dpi=_DPI, format=path.suffix[1:].lower())
