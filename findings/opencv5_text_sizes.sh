#!/usr/bin/env bash
# OpenCV 5: cv2.getTextSize measures the text, not the font, and a blank is half as wide.
#
# Versions: opencv-python-headless 4.12.0.88 and 5.0.0.93, numpy 2.2.6.
#
# Behaviour: with the same call, putText(..., FONT_HERSHEY_SIMPLEX, ...), OpenCV 5 draws an outline
# font instead of Hershey's strokes. Three things follow that nothing announces:
#   1. The second value of getTextSize (the baseline: how far letters reach below the line) is that
#      of the given letters: 0 for "A", 7 for "g" at scale 1. In OpenCV 4 it is 10 for any text.
#   2. The font size is rounded to whole pixels: scales 0.40 and 0.42 give the same width.
#   3. A blank adds 3 px between digits at scale 0.4, where OpenCV 4 adds 6: "27 80" reads "2780".
#
# Why it surprises: the usual code for a label measures its height once, with a sample text or with
# the label itself, as height + baseline. In OpenCV 4 any text gives the same height; in OpenCV 5 the
# boxes of "A" and "g" differ, and a line height that was measured with "0" cuts off g, j, p, q, y.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/measure.py" <<'PYTHON'
import json
import cv2


def size(text, scale):
    (width, height), baseline = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    return width, height, baseline


found = {
    'version': cv2.__version__,
    'baselines': [size(text, 1.0)[2] for text in 'A0g'],
    'widths': [size('Van 27 80.3 m', scale)[0] for scale in (0.40, 0.42)],
    'blank': size('27 80', 0.4)[0] - size('2780', 0.4)[0],
}
print(json.dumps(found))
PYTHON
for version in 4.12.0.88 5.0.0.93; do
  python3 -m venv "$folder/$version"
  "$folder/$version/bin/pip" install -q "opencv-python-headless==$version" numpy==2.2.6
  "$folder/$version/bin/python" "$folder/measure.py" | tee "$folder/$version.json"
done
python3 - "$folder/4.12.0.88.json" "$folder/5.0.0.93.json" <<'PYTHON'
import json
import sys

four, five = (json.load(open(path)) for path in sys.argv[1:])
assert four['baselines'] == [10, 10, 10], four
assert five['baselines'] == [0, 1, 7], five
assert four['widths'][0] < four['widths'][1], four
assert five['widths'][0] == five['widths'][1], five
assert (four['blank'], five['blank']) == (6, 3), (four, five)
print('confirmed')
PYTHON
