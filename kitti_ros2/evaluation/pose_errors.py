# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Absolute and relative pose errors (APE, RPE), by evo."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.errors import UsageError
from ..options.eval_odometry import Alignment

if TYPE_CHECKING:
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """The errors of M frames, after an alignment.

    Attributes:
        ape_m: (M,) distances of the positions, metres.
        rpe_m: (K,) errors of the steps from a frame to the next, metres; steps over missing frames
            are left out.
        positions: (M, 3) aligned positions of the result.
        scale: Factor of the alignment; 1 unless it scales.
    """

    ape_m: Float64Array
    rpe_m: Float64Array
    positions: Float64Array
    scale: float = 1.0


def check_evo() -> None:
    """Check that evo is installed.

    Raises:
        UsageError: It is not.
    """
    if find_spec('evo') is None:
        raise UsageError(
            "eval odometry needs evo, which is not installed; run pip install 'kitti_ros2[eval]'"
        )


def pose_errors(
    numbers: Int64Array, ground_truth: Float64Array, result: Float64Array, alignment: Alignment
) -> PoseErrors:
    """Compute APE and RPE of the translation, as evo_ape and evo_rpe do.

    Args:
        numbers: (M,) frame numbers.
        ground_truth: (M, 4, 4) poses.
        result: (M, 4, 4) poses.
        alignment: How the result is aligned first.

    Raises:
        UsageError: The alignment is not possible.
    """
    from evo.core.metrics import APE, RPE, PoseRelation  # noqa: PLC0415 - heavy, and an extra
    from evo.core.trajectory import PosePath3D  # noqa: PLC0415 - as above

    reference, estimate = (PosePath3D(poses_se3=[*rigid(each)]) for each in (ground_truth, result))
    scale = _align(estimate, reference, alignment)
    ape = APE(PoseRelation.translation_part)
    ape.process_data((reference, estimate))
    steps = np.zeros(0)
    if len(numbers) > 1:
        rpe = RPE(PoseRelation.translation_part, delta=1)
        rpe.process_data((reference, estimate))
        after = np.array(rpe.delta_ids)
        steps = np.asarray(rpe.error)[numbers[after] - numbers[after - 1] == 1]
    return PoseErrors(np.asarray(ape.error), steps, np.asarray(estimate.positions_xyz), scale)


def _align(estimate: Any, reference: Any, alignment: Alignment) -> float:  # noqa: ANN401 - of evo
    """Align a path of evo in place; return the scale."""
    from evo import EvoException  # noqa: PLC0415 - as above

    try:
        if alignment in {Alignment.FIRST, Alignment.SCALE}:
            estimate.align_origin(reference)
        elif alignment is not Alignment.NONE:
            *_, scale = estimate.align(reference, correct_scale=alignment is Alignment.SIM3)
            return float(scale)
    except EvoException as error:
        other = Alignment.SCALE if alignment is Alignment.SIM3 else Alignment.FIRST
        raise UsageError(
            f'--align {alignment.value} is not possible (positions on a line, or at one place, do'
            f' not tell the rotation); give --align {other.value}'
        ) from error
    return 1.0


def fit_scale(ground_truth: Float64Array, result: Float64Array, alignment: Alignment) -> float:
    """Return the factor of the result's positions by which they fit those of the ground truth.

    Both are those of kitti-odom-eval (kitti_odometry.py, 2019), by which monocular odometry is
    reported: for sim3 that of the alignment of all positions (Umeyama), as its 7dof; for scale the
    least squares of positions from the first pose, as its scale.

    Args:
        ground_truth: (M, 4, 4) poses.
        result: (M, 4, 4) poses.
        alignment: One with a scale.

    Raises:
        UsageError: The alignment is not possible.
    """
    if alignment is Alignment.SIM3:
        return pose_errors(np.arange(len(result)), ground_truth, result, alignment).scale
    true, found = ((np.linalg.inv(poses[0]) @ poses)[:, :3, 3] for poses in (ground_truth, result))
    squares, product = float(np.sum(found * found)), float(np.sum(found * true))
    if not squares or product <= 0:
        raise UsageError(
            f'--align {alignment.value} is not possible (the result does not move along the ground'
            f' truth); give --align first'
        )
    return product / squares


def rmse(errors: Float64Array) -> float | None:
    """Return the root of the mean square; None without errors."""
    return float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else None


def rigid(poses: Float64Array) -> Float64Array:
    """Return (M, 4, 4) poses with the rotations nearest to theirs.

    evo refuses matrices that are rounded to fewer than six digits.
    """
    u, _, vh = np.linalg.svd(poses[:, :3, :3])
    found: Float64Array = poses.copy()
    found[:, :3, :3] = u @ vh
    return found
