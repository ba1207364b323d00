#!/usr/bin/env bash
# pymcap-cli: roscompress makes video of PNG and JPEG with full-range luma and does not flag it.
#
# Versions: pymcap-cli 0.34.0, PyAV 18.1.0 (FFmpeg 8.1.2), mcap 1.4.0, Python 3.11.
#
# Behaviour: the same black and white pixels are written once as sensor_msgs/Image and once as PNG
# in sensor_msgs/CompressedImage. Of the Image roscompress makes H.264 with black at luma 16 and
# white at 235. Of the PNG it makes H.264 with 0 and 255. Neither stream has video_full_range_flag.
#
# Why it surprises: the two images are equal pixel by pixel, and so should be their videos. Every
# decoder takes luma without the flag as limited range: what was PNG comes back with the contrast
# stretched by 255/219, and with shades near black and white clipped, 12 grey levels off in the mean
# on camera images; nothing in the bag tells which of the two a topic is.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/check.py" <<'PYTHON'
import struct
import subprocess
import sys
import zlib
from importlib.metadata import version
from pathlib import Path

import av
from mcap.reader import make_reader
from mcap.writer import Writer

WIDTH, HEIGHT, FRAMES = 256, 64, 6
HEADER = 'std_msgs/Header header\n'
TYPES = {
    'sensor_msgs/msg/Image': HEADER + 'uint32 height\nuint32 width\nstring encoding\n'
    'uint8 is_bigendian\nuint32 step\nuint8[] data\n',
    'sensor_msgs/msg/CompressedImage': HEADER + 'string format\nuint8[] data\n',
}
NESTED = (
    f'{"=" * 80}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n'
    f'{"=" * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n'
)


class Cdr:
    def __init__(self):
        self.data = bytearray()

    def number(self, value):
        self.data += bytes(-len(self.data) % 4) + struct.pack('<I', value)
        return self

    def text(self, value):
        self.number(len(value) + 1).data += value.encode() + b'\0'
        return self

    def octets(self, value):
        self.number(len(value)).data += value
        return self


def png(pixels):
    def chunk(kind, data):
        end = struct.pack('>I', zlib.crc32(kind + data))
        return struct.pack('>I', len(data)) + kind + data + end

    step = 3 * WIDTH
    rows = b''.join(b'\0' + pixels[row * step : (row + 1) * step] for row in range(HEIGHT))
    head = struct.pack('>IIBBBBB', WIDTH, HEIGHT, 8, 2, 0, 0, 0)
    return (
        b'\x89PNG\r\n\x1a\n'
        + chunk(b'IHDR', head)
        + chunk(b'IDAT', zlib.compress(rows))
        + chunk(b'IEND', b'')
    )


def message(kind, number, pixels):
    cdr = Cdr().number(100).number(number).text('camera')
    if kind.endswith('CompressedImage'):
        cdr.text('png').octets(png(pixels))
    else:
        cdr.number(HEIGHT).number(WIDTH).text('rgb8')
        cdr.data += b'\0'
        cdr.number(3 * WIDTH).octets(pixels)
    return b'\0\1\0\0' + bytes(cdr.data)


def luma(folder, kind):
    """The luma of the first frame of the video: at its black, and at its white half."""
    source, out = folder / 'in.mcap', folder / 'out.mcap'
    pixels = (b'\0' * (3 * WIDTH // 2) + b'\xff' * (3 * WIDTH // 2)) * HEIGHT
    with source.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros2')
        schema = writer.register_schema(kind, 'ros2msg', (TYPES[kind] + NESTED).encode())
        channel = writer.register_channel('/image', 'cdr', schema)
        for number in range(FRAMES):
            writer.add_message(channel, number, message(kind, number, pixels), number)
        writer.finish()
    tool = Path(sys.executable).with_name('pymcap-cli')
    subprocess.run(
        [tool, '--quiet', 'roscompress', source, '-o', out, '--force', '--encoder', 'libx264'],
        check=True,
        capture_output=True,
    )
    with out.open('rb') as stream:
        schema, _, stored = next(iter(make_reader(stream).iter_messages()))
    assert schema.name == 'foxglove_msgs/msg/CompressedVideo', schema.name
    decoder = av.CodecContext.create('h264', 'r')
    start = stored.data.index(b'\0\0\0\1')
    frames = [*decoder.decode(av.Packet(stored.data[start:])), *decoder.decode(None)]
    plane, size = bytes(frames[0].planes[0]), frames[0].planes[0].line_size
    middle = HEIGHT // 2 * size
    black, white, flag = plane[middle + 40], plane[middle + 216], frames[0].color_range
    print(f'{kind}: black {black}, white {white}, range {flag} (0 unspecified, 2 full)')
    return black, white, int(flag)


folder = Path(sys.argv[1])
print('pymcap-cli', version('pymcap-cli'), 'av', av.__version__)
raw = luma(folder, 'sensor_msgs/msg/Image')
compressed = luma(folder, 'sensor_msgs/msg/CompressedImage')
assert abs(raw[0] - 16) < 4 and abs(raw[1] - 235) < 4, raw
assert compressed[0] < 4 and compressed[1] > 251, compressed
assert 2 not in {raw[2], compressed[2]}, 'full range is flagged'
PYTHON
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q 'pymcap-cli[video,pointcloud]==0.34.0' av==18.1.0 mcap==1.4.0
"$folder/venv/bin/python" "$folder/check.py" "$folder"
