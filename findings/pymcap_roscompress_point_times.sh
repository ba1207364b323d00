#!/usr/bin/env bash
# pymcap-cli: roscompress rounds the times of points to the resolution that is meant for metres.
#
# Versions: pymcap-cli 0.34.0, pureini 0.10.0, mcap 1.6.0, mcap-ros2-support 0.6.0, Python 3.11.
#
# Behaviour: a cloud as the Velodyne driver publishes it has x y z intensity (float32), ring (uint16)
# and time (float32, seconds within the turn). With the default --resolution 0.01 coordinates are
# within 5 mm, as one expects; but time has the same resolution, and of 10,000 times of a turn of
# 0.1 s there are 11 left. --pointcloud-topic-options gives a topic a resolution, not a field.
#
# Why it surprises: a resolution of points is taken for one of coordinates, and a centimetre is
# harmless. 10 ms are 36 degrees of the turn: deskewing places points of a car at 20 m/s by up to
# 0.1 m wrongly, without a word from any tool, for the field is there and spans the turn as before.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/check.py" <<'PYTHON'
import struct
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer

POINTS, TURN_S = 10_000, 0.1
POINT = struct.Struct('<ffffHf')
FIELDS = [('x', 0, 7), ('y', 4, 7), ('z', 8, 7), ('intensity', 12, 7), ('ring', 16, 4), ('time', 18, 7)]
TYPE = (
    'std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\n'
    'bool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n'
    + '=' * 80
    + '\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n'
    + '=' * 80
    + '\nMSG: sensor_msgs/PointField\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n'
    + '=' * 80
    + '\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n'
)


def columns(path):
    """x and time of the points of the only message."""
    with path.open('rb') as stream:
        _, _, _, cloud = next(
            iter(make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
        )
    offsets = {field.name: field.offset for field in cloud.fields}
    data = bytes(cloud.data)
    starts = range(0, len(data), cloud.point_step)
    return [
        [struct.unpack_from('<f', data, start + offsets[name])[0] for start in starts]
        for name in ('x', 'time')
    ]


def run(command, source, out):
    tool = Path(sys.executable).with_name('pymcap-cli')
    subprocess.run([tool, '--quiet', command, source, '-o', out], check=True, capture_output=True)


folder = Path(sys.argv[1])
points = b''.join(
    POINT.pack(5 + row / 777, -3.0, 0.5, row % 100 / 100, row % 64, TURN_S * row / POINTS)
    for row in range(POINTS)
)
with (folder / 'in.mcap').open('wb') as stream:
    writer = Writer(stream)
    cloud = {
        'header': {'stamp': {'sec': 100, 'nanosec': 0}, 'frame_id': 'velodyne'},
        'height': 1,
        'width': POINTS,
        'fields': [
            {'name': name, 'offset': offset, 'datatype': datatype, 'count': 1}
            for name, offset, datatype in FIELDS
        ],
        'is_bigendian': False,
        'point_step': POINT.size,
        'row_step': len(points),
        'data': points,
        'is_dense': True,
    }
    schema = writer.register_msgdef('sensor_msgs/msg/PointCloud2', TYPE)
    writer.write_message('/velodyne_points', schema, cloud, 1, 1)
    writer.finish()
run('roscompress', folder / 'in.mcap', folder / 'compressed.mcap')
run('rosdecompress', folder / 'compressed.mcap', folder / 'out.mcap')
(x, times), (x_after, times_after) = columns(folder / 'in.mcap'), columns(folder / 'out.mcap')
assert len(x) == len(x_after) == POINTS
farthest = max(abs(after - before) for before, after in zip(x, x_after))
print('pymcap-cli', version('pymcap-cli'), 'pureini', version('pureini'))
print(f'x: at most {farthest:.4f} m off')
print(f'time: {len(set(times))} values before, {len(set(times_after))} after')
assert farthest < 0.0051, farthest
assert len(set(times)) == POINTS
assert len(set(times_after)) == 11, 'times are kept better than to 0.01 s'
PYTHON
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q 'pymcap-cli[video,pointcloud]==0.34.0' pureini==0.10.0 pointcloud2==0.6.0 \
  mcap==1.6.0 mcap-ros2-support==0.6.0
"$folder/venv/bin/python" "$folder/check.py" "$folder"
