# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What python -m benchmarks compares with: the shortest loop over a library; and inputs for it.

    python benchmarks/peers.py ROLE WORD...

Each is a process of its own, and imports its library only.
"""

from __future__ import annotations

import os
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

FRAMES, OBJECTS = 3769, 12
START_NS, PERIOD_NS = 1_317_042_145_951_199_337, 103_600_000
CLOUD, COMPRESSED = 'sensor_msgs/msg/PointCloud2', 'sensor_msgs/msg/CompressedImage'
SCANS, IMAGES = '/kitti/velo/points', '/kitti/camera_color_left/image_rect/compressed'
STREAMS = ('velodyne_points', 'image_00', 'image_01', 'image_02', 'image_03')


def files_of(drive: str, *streams: str) -> list[list[Path]]:
    """The files of some streams of a drive, by stream."""
    return [sorted(Path(drive, stream, 'data').iterdir()) for stream in streams]


def messages(drive: str, types: Any, *, ros1: bool) -> Iterator[tuple[str, int, Any]]:  # noqa: ANN401
    """Scans and images of a drive: topic, stamp, and a message of the classes of rosbags."""
    header = types['std_msgs/msg/Header']
    field = types['sensor_msgs/msg/PointField']
    fields = [field(name, 4 * place, 7, 1) for place, name in enumerate('xyzi')]
    for number, paths in enumerate(zip(*files_of(drive, *STREAMS), strict=True)):
        stamp_ns = START_NS + number * PERIOD_NS
        time_of = types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
        for stream, path in zip(STREAMS, paths, strict=True):
            head = header(*([number] if ros1 else []), time_of, stream)
            data = np.fromfile(path, np.uint8)
            if path.suffix == '.bin':
                count = len(data) // 16
                layout = {'is_bigendian': False, 'point_step': 16, 'row_step': len(data)}
                made = types[CLOUD](head, 1, count, fields, **layout, data=data, is_dense=True)
            else:
                made = types[COMPRESSED](head, 'png', data)
            yield f'/{stream}', stamp_ns, made


def write_rosbags(storage: str, drive: str, out: str) -> None:
    """Write a drive with rosbags: ros1, sqlite3 or mcap."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    ros1 = storage == 'ros1'
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    writer: Any = (
        rosbag1.Writer(out)
        if ros1
        else rosbag2.Writer(
            Path(out), version=9, storage_plugin=rosbag2.StoragePlugin[storage.upper()]
        )
    )
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    connections: dict[str, Any] = {}
    with writer:
        for topic, stamp_ns, message in messages(drive, store.types, ros1=ros1):
            msgtype = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, msgtype, typestore=store)
            writer.write(connections[topic], stamp_ns, serialize(message, msgtype))


def write_mcap(drive: str, out: str) -> None:
    """Write a drive with the library mcap, without compression."""
    from mcap.writer import CompressionType, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    channels: dict[str, int] = {}
    with open(out, 'wb') as file:  # noqa: PTH123
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start('ros2')
        for topic, stamp_ns, message in messages(drive, store.types, ros1=False):
            msgtype = message.__msgtype__
            if topic not in channels:
                text = store.generate_msgdef(msgtype, ros_version=2)[0].encode()
                schema = writer.register_schema(msgtype, 'ros2msg', text)
                channels[topic] = writer.register_channel(topic, 'cdr', schema)
            data = bytes(store.serialize_cdr(message, msgtype))
            writer.add_message(channels[topic], stamp_ns, data, stamp_ns)
        writer.finish()  # type: ignore[no-untyped-call]


def read_write(bag: str, out: str) -> None:
    """Read scans and images of a bag with rosbags, and write their files."""
    from rosbags.highlevel import AnyReader

    with AnyReader([Path(bag)]) as reader:
        chosen = [each for each in reader.connections if each.msgtype in (CLOUD, COMPRESSED)]
        for each in chosen:
            Path(out, each.topic[1:]).mkdir(parents=True)
        for connection, stamp_ns, data in reader.messages(chosen):
            message: Any = reader.deserialize(data, connection.msgtype)
            message.data.tofile(Path(out, connection.topic[1:], str(stamp_ns)))


def read_frames(library: str, source: str, *, image: bool) -> int:
    """Read the points of all frames, and the image of camera 2; return the number of points."""
    if library == 'kitti_ros2':
        import kitti_ros2

        return sum(
            len(frame.points) + (frame.image(2) is None if image else 0)
            for frame in kitti_ros2.open(source)
        )
    if library == 'numpy':
        (paths,) = files_of(source, 'velodyne_points')
        return sum(len(np.fromfile(path, np.float32).reshape(-1, 4)) for path in paths)
    if library == 'pykitti':
        import pykitti

        base, date, drive = Path(source).parents[1], Path(source).parent.name, Path(source).name
        raw = pykitti.raw(str(base), date, drive.split('_')[4])
        return sum(len(points) for points in raw.velo)
    return sum(
        len(_decoded(topic, message))
        for topic, message in _of_bag(library, source, [SCANS, IMAGES][: 1 + image])
    )


def _of_bag(library: str, bag: str, topics: list[str]) -> Iterator[tuple[str, Any]]:
    if library == 'mcap-ros2-support':
        from mcap_ros2.reader import read_ros2_messages

        for each in read_ros2_messages(bag, topics):
            yield each.channel.topic, each.ros_msg
        return
    from rosbags.highlevel import AnyReader

    with AnyReader([Path(bag)]) as reader:
        chosen = [each for each in reader.connections if each.topic in topics]
        for connection, _, data in reader.messages(chosen):
            yield connection.topic, reader.deserialize(data, connection.msgtype)


def _decoded(topic: str, message: Any) -> Any:  # noqa: ANN401
    if topic == SCANS:
        return np.frombuffer(message.data, np.float32).reshape(-1, message.point_step // 4)
    import cv2

    return cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)


def open_bag(library: str, bag: str) -> None:
    """Open a bag as info does, and as the first frame needs it."""
    if library == 'mcap':
        from mcap.reader import make_reader

        with open(bag, 'rb') as file:  # noqa: PTH123
            make_reader(file).get_summary()
    else:
        from rosbags.highlevel import AnyReader

        with AnyReader([Path(bag)]):
            pass


def first_frame(source: str) -> None:
    """Read the points of the first frame with kitti_ros2."""
    import kitti_ros2

    print(len(next(iter(kitti_ros2.open(source))).points))


def poses(source: str) -> None:
    """Read the poses of all frames with kitti_ros2."""
    import kitti_ros2

    print(len([frame.pose for frame in kitti_ros2.open(source)]))


def decode(drive: str) -> None:
    """Decode the images of a drive with OpenCV, on all cores."""
    import cv2

    cv2.setNumThreads(1)
    paths = [path for paths in files_of(drive, *STREAMS[1:]) for path in paths]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(lambda path: cv2.imread(str(path), cv2.IMREAD_UNCHANGED), paths))


def write_differences(drive: str, out: str) -> None:
    """Write the rows of the images of a drive as PNG of KITTI's form deflates them."""
    import cv2

    Path(out).mkdir()
    for number, path in enumerate(chain(*files_of(drive, *STREAMS[1:]))):
        pixels: Any = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        step, wide = pixels[0, 0].size, pixels.reshape(len(pixels), -1)
        rows = np.ones((len(wide), 1 + wide.shape[1]), np.uint8)
        rows[:, 1:] = wide
        rows[:, 1 + step :] -= wide[:, :-step]
        rows.tofile(Path(out, str(number)))


def deflate(folder: str) -> None:
    """Deflate what write_differences has written, on all cores."""
    library: Any = zlib
    with suppress(ImportError):
        from zlib_ng import zlib_ng as library

    def pack(path: Path) -> None:
        packer = library.compressobj(1, zlib.DEFLATED, 15, 8, zlib.Z_HUFFMAN_ONLY)
        packer.compress(path.read_bytes())
        packer.flush()

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(pack, Path(folder).iterdir()))


def convert_numbers(folder: str) -> None:
    """Read all text files of a folder, and convert their numbers."""
    for path in Path(folder).rglob('*.txt'):
        for line in path.read_text().splitlines():
            [float(word) for word in line.split()[1:]]


def write_labels(out: str) -> None:
    """Write random labels, and the results of a detector that errs, as the devkit has them."""
    folder, rng = Path(out), np.random.default_rng(7)
    sizes_hwl = {'Car': (1.5, 1.6, 3.9), 'Pedestrian': (1.8, 0.7, 0.8), 'Cyclist': (1.7, 0.6, 1.8)}
    for name in ('label_2', 'data'):
        (folder / name).mkdir(parents=True)
    for number in range(FRAMES):
        labels, results = [], []
        for name in rng.choice([*sizes_hwl], OBJECTS):
            place = np.array([rng.normal(0, 8), 1.7, rng.uniform(5, 50)])
            angle = rng.uniform(-np.pi, np.pi)
            labels.append(_label(name, sizes_hwl[name], place, angle))
            moved = place + rng.normal(0, 0.1, 3), angle + rng.normal(0, 0.05)
            results.append(f'{_label(name, sizes_hwl[name], *moved)} {rng.random():.3f}')
        (folder / 'label_2' / f'{number:06d}.txt').write_text('\n'.join(labels))
        (folder / 'data' / f'{number:06d}.txt').write_text('\n'.join(results))
    for link, target in (('data/object/label_2', 'label_2'), ('results/r/data', 'data')):
        (folder / link).parent.mkdir(parents=True)
        (folder / link).symlink_to(folder / target)


def _label(
    name: str, size_hwl: Sequence[float], place: np.ndarray[tuple[int], np.dtype[np.float64]],
    angle: float,
) -> str:  # fmt: skip
    u, v = 610 + 720 * place[0] / place[2], 172 + 720 * place[1] / place[2]
    height, width = 720 * size_hwl[0] / place[2], 720 * size_hwl[2] / place[2]
    box = u - width / 2, v - height, u + width / 2, v
    return f'{name} 0 0 {" ".join(f"{n:.2f}" for n in (angle, *box, *size_hwl, *place, angle))}'


def write_trajectories(out: str) -> None:
    """Write a trajectory of 4541 poses, and one that drifts from it."""
    folder = Path(out)
    folder.mkdir()
    for name, drift in (('a', 0.0), ('b', 1e-5)):
        yaw = np.cumsum(np.full(4541, 1e-3 + drift))
        x, z = np.cumsum(np.sin(yaw)), np.cumsum(np.cos(yaw))
        zero, one = np.zeros(4541), np.ones(4541)
        rows = np.cos(yaw), zero, np.sin(yaw), x, zero, one, zero, zero, -np.sin(yaw), zero
        np.savetxt(folder / f'{name}.txt', np.column_stack([*rows, np.cos(yaw), z]))


def main() -> None:
    """Run a role."""
    role, *words = sys.argv[1:]
    functions: dict[str, Any] = {
        'write-rosbags': write_rosbags,
        'write-mcap': write_mcap,
        'read-write': read_write,
        'points': lambda *given: read_frames(*given, image=False),
        'points-and-image': lambda *given: read_frames(*given, image=True),
        'open': open_bag,
        'first-frame': first_frame,
        'poses': poses,
        'decode': decode,
        'numbers': convert_numbers,
        'deflate': deflate,
        'differences': write_differences,
        'labels': write_labels,
        'trajectories': write_trajectories,
    }
    functions[role](*words)


if __name__ == '__main__':
    main()
