# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The library of faults (faults/call_faults.c), compiled."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from pathlib import Path

_SOURCE = Path(__file__).with_name('faults') / 'call_faults.c'


def compiler_of_faults() -> str | None:
    """Return the C compiler; None where there is none, or no Linux with glibc."""
    if not sys.platform.startswith('linux') or platform.libc_ver()[0] != 'glibc':
        return None
    return shutil.which('cc') or shutil.which('gcc')


def compile_faults(folder: Path) -> Path:
    """Compile the library of faults to a folder.

    Raises:
        FileNotFoundError: There is no compiler.
        subprocess.CalledProcessError: The compiler fails.
    """
    compiler = compiler_of_faults()
    if compiler is None:
        raise FileNotFoundError('needs Linux with glibc, and a C compiler')
    library = folder / 'call_faults.so'
    subprocess.run([compiler, '-shared', '-fPIC', '-o', library, _SOURCE, '-ldl'], check=True)
    return library
