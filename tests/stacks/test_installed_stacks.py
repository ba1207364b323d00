# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Installed odometry stacks on their bags: little drift with deskewing, twice as much without.

pip install kiss-icp genz-icp rko_lio
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

pytestmark = pytest.mark.programs

BENCHMARKS = Path(__file__).parents[2] / 'benchmarks'
MODULES = {'kiss-icp': 'kiss_icp', 'genz-icp': 'genz_icp', 'rko_lio': 'rko_lio'}
INSTALLED = [
    pytest.param(
        stack,
        marks=pytest.mark.skipif(find_spec(module) is None, reason=f'{stack} is not installed'),
    )
    for stack, module in MODULES.items()
]


@pytest.fixture(scope='module')
def benchmark():
    """The module benchmarks/stacks.py."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(BENCHMARKS)
        yield import_module('stacks')


@pytest.fixture(scope='module')
def street(benchmark):
    """A shorter drive than that of the benchmark, with fewer points."""
    return benchmark.make_street(frames=140, columns=400)


@pytest.fixture(scope='module')
def swept_drive(benchmark, street, tmp_path_factory):
    """Its folder."""
    return benchmark.write_drive(tmp_path_factory.mktemp('street'), street)


@pytest.mark.parametrize('stack', INSTALLED)
def test_deskewing_halves_the_drift(stack, benchmark, street, swept_drive, tmp_path):
    bag = benchmark.write_bag(swept_drive, stack, tmp_path / 'bag')
    found = benchmark.measure(benchmark.PROGRAMS[stack], street, bag, tmp_path / 'runs')
    assert found.on < 1.0, found
    assert found.off >= 2 * found.on, found
