# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Read a data set for training, in the style of PyTorch.

python examples/training_dataset.py RECORDING

torch.utils.data.DataLoader takes it as it is, also with worker processes. It runs without PyTorch:
arrays become tensors by torch.from_numpy, which shares their memory.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

import kitti_ros2

if TYPE_CHECKING:
    import numpy.typing as npt

CLASSES = ('Car', 'Pedestrian', 'Cyclist')


class KittiDetection:
    """Frames with a scan, for 3D detection.

    Args:
        path: A KITTI folder, or a bag.
        classes: Of the objects to return; their places are the class numbers.
        options: Of kitti_ros2.open.
    """

    def __init__(self, path: str, classes: tuple[str, ...] = CLASSES, **options: Any) -> None:
        self.classes = classes
        self._recording = kitti_ros2.open(path, **options)
        self._numbers = self._recording.streams['scan'].tolist()

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, index: int) -> dict[str, npt.NDArray[Any]]:
        """Return a sample.

        Returns:
            points (N, 4) float32, gt_boxes (M, 7) float32 (x y z l w h yaw in velo_link) and
            gt_classes (M,) int64.
        """
        frame = self._recording.frame(self._numbers[index])
        kept = [one for one in frame.objects if one.has_box and one.class_name in self.classes]
        return {
            'points': frame.points,
            'gt_boxes': np.array([one.box for one in kept], np.float32).reshape(-1, 7),
            'gt_classes': np.array([self.classes.index(one.class_name) for one in kept], np.int64),
        }


def collate(samples: list[dict[str, npt.NDArray[Any]]]) -> dict[str, npt.NDArray[Any]]:
    """Join samples as OpenPCDet does: a first column of points and boxes is the sample's place."""
    joined = {}
    for key in samples[0]:
        rows = [sample[key].reshape(len(sample[key]), -1) for sample in samples]
        places = np.repeat(np.arange(len(rows)), [len(row) for row in rows])[:, None]
        joined[key] = np.hstack([places.astype(rows[0].dtype), np.vstack(rows)])
    return joined


def main(path: str) -> None:
    """Print the shapes of a batch."""
    dataset = KittiDetection(path)
    batch = collate([dataset[index] for index in range(min(2, len(dataset)))])
    for key, values in batch.items():
        print(f'{key}: {values.shape} {values.dtype}')
    try:
        import torch  # noqa: PLC0415
    except ImportError:
        return
    points = torch.from_numpy(dataset[0]['points'])
    print(f'as a tensor: {tuple(points.shape)} {points.dtype}')


if __name__ == '__main__':
    main(sys.argv[1])
