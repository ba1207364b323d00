# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The rules of KITTI's object benchmark, one object after the other, for comparison.

It shares no code with the package: it reads the text of label files, clips polygons of float
tuples, and loops over labels, detections and thresholds.
"""

from __future__ import annotations

import math

LEVELS = {'easy': (40, 0, 0.15), 'moderate': (25, 1, 0.30), 'hard': (25, 2, 0.50)}
CLASSES = {'car': 0.7, 'pedestrian': 0.5, 'cyclist': 0.5}
NEIGHBOUR = {'car': 'van', 'pedestrian': 'person_sitting'}
METRICS = ('2d', 'bev', '3d')


class Line:
    def __init__(self, text):
        words = text.split()
        self.kind = words[0].lower()
        numbers = [float(word) for word in words[1:]]
        self.truncated, self.occluded, self.alpha = numbers[:3]
        self.rectangle = numbers[3:7]
        self.height, self.width, self.length, self.x, self.y, self.z, self.ry = numbers[7:14]
        self.score = numbers[14] if len(numbers) > 14 else None
        self.pixels = self.rectangle[3] - self.rectangle[1]

    def outline(self):
        cos, sin = math.cos(self.ry), math.sin(self.ry)
        quad = []
        for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
            along, across = i * self.length / 2, j * self.width / 2
            quad.append((self.x + cos * along + sin * across, self.z - sin * along + cos * across))
        return quad


def shoelace(polygon):
    total = 0.0
    for (a, b), (c, d) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        total += a * d - b * c
    return abs(total) / 2


def clip(polygon, first, second):
    """The part of a polygon to the right of the line from one point to another."""

    def side(point):
        return (second[0] - first[0]) * (point[1] - first[1]) - (second[1] - first[1]) * (
            point[0] - first[0]
        )

    clipped = []
    for start, end in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        s, e = side(start), side(end)
        if s <= 0:
            clipped.append(start)
        if (s < 0 < e) or (e < 0 < s):
            t = s / (s - e)
            clipped.append((start[0] + t * (end[0] - start[0]), start[1] + t * (end[1] - start[1])))
    return clipped


def ground_intersection(a, b):
    reach = math.hypot(a.length, a.width) + math.hypot(b.length, b.width)
    if math.hypot(a.x - b.x, a.z - b.z) > reach:
        return 0.0
    polygon, other = a.outline(), b.outline()
    for first, second in zip(other, other[1:] + other[:1], strict=True):
        polygon = clip(polygon, first, second)
    return shoelace(polygon) if len(polygon) > 2 else 0.0


def overlap(metric, det, gt, by_detection=False):
    if metric == '2d':
        left, top, right, bottom = (
            f(p, q)
            for f, p, q in zip((max, max, min, min), det.rectangle, gt.rectangle, strict=True)
        )
        if right <= left or bottom <= top:
            return 0.0
        common = (right - left) * (bottom - top)
        sizes = [(r[2] - r[0]) * (r[3] - r[1]) for r in (det.rectangle, gt.rectangle)]
    else:
        common = ground_intersection(det, gt)
        sizes = [box.length * box.width for box in (det, gt)]
        if metric == '3d':
            common *= max(min(det.y, gt.y) - max(det.y - det.height, gt.y - gt.height), 0.0)
            sizes = [size * box.height for size, box in zip(sizes, (det, gt), strict=True)]
    whole = sizes[0] if by_detection else sizes[0] + sizes[1] - common
    return common / whole if whole else 0.0


class Frame:
    """A frame for one class, metric and level: who concerns whom."""

    def __init__(self, gts, dets, kind, metric, level, limit, cache):
        height, occluded, truncated = LEVELS[level]
        self.limit, self.dets = limit, dets
        self.gts = []
        for place, gt in enumerate(gts):
            hard = gt.occluded > occluded or gt.truncated > truncated or gt.pixels <= height
            if gt.kind == kind:
                self.gts.append((place, gt, hard))
            elif gt.kind == NEIGHBOUR.get(kind):
                self.gts.append((place, gt, True))
        self.ignored = {}
        for place, det in enumerate(dets):
            if math.floor(abs(det.pixels)) < height:
                self.ignored[place] = True
            elif det.kind == kind:
                self.ignored[place] = False
        self.overlaps = cache.setdefault(metric, {})
        self._find_overlaps(metric)
        self.stuff = {
            j
            for j in self.ignored
            for gt in gts
            if gt.kind == 'dontcare' and overlap(metric, dets[j], gt, by_detection=True) > limit
        }

    def _find_overlaps(self, metric):
        for i, gt, _ in self.gts:
            for j in self.ignored:
                if (i, j) not in self.overlaps:
                    self.overlaps[i, j] = overlap(metric, self.dets[j], gt)

    def counted(self):
        return sum(not hard for _, _, hard in self.gts)

    def scores(self):
        used, true_scores = set(), []
        for i, _, hard in self.gts:
            best = None
            for j in self.ignored:
                if j in used or self.overlaps[i, j] <= self.limit:
                    continue
                if best is None or self.dets[j].score > self.dets[best].score:
                    best = j
            if best is not None:
                used.add(best)
                if not hard and not self.ignored[best]:
                    true_scores.append(self.dets[best].score)
        return true_scores

    def count(self, threshold):
        """True positives, false positives, similarity."""
        alive = [j for j in self.ignored if self.dets[j].score >= threshold]
        used, right, similarity = set(), 0, 0.0
        for i, gt, hard in self.gts:
            free = [j for j in alive if j not in used and self.overlaps[i, j] > self.limit]
            real = [j for j in free if not self.ignored[j]]
            best = None
            for j in real:
                if best is None or self.overlaps[i, j] > self.overlaps[i, best]:
                    best = j
            if best is None and free:
                best = free[0]
            if best is None:
                continue
            used.add(best)
            if not hard and not self.ignored[best]:
                right += 1
                similarity += (1 + math.cos(gt.alpha - self.dets[best].alpha)) / 2
        wrong = sum(
            1 for j in alive if not self.ignored[j] and j not in used and j not in self.stuff
        )
        return right, wrong, similarity


def sampled(scores, objects):
    thresholds, recall = [], 0.0
    scores = sorted(scores)[::-1]
    for i in range(len(scores)):
        left = (i + 1) / objects
        right = (i + 2) / objects if i + 1 < len(scores) else left
        if i + 1 < len(scores) and right - recall < recall - left:
            continue
        thresholds.append(scores[i])
        recall += 1 / 40
    return thresholds


def averages(points):
    points = points + [0.0] * (41 - len(points))
    highest = [max(points[i:]) for i in range(41)]
    return {'R40': 100 * sum(highest[1:]) / 40, 'R11': 100 * sum(highest[::4]) / 11}


def evaluate(gt_texts, det_texts, classes=CLASSES):
    """Scores by class, metric and level, from the texts of files by frame."""
    frames = [
        [[Line(line) for line in text.splitlines()] for text in texts]
        for texts in zip(gt_texts, det_texts, strict=True)
    ]
    caches = [{} for _ in frames]
    scores = {}
    for kind, limit in classes.items():
        scores[kind] = {metric: {} for metric in (*METRICS, 'aos')}
        for metric in METRICS:
            for level in LEVELS:
                evaluated = [
                    Frame(gts, dets, kind, metric, level, limit, cache)
                    for (gts, dets), cache in zip(frames, caches, strict=True)
                ]
                evaluated = [frame for frame in evaluated if frame.gts or frame.ignored]
                objects = sum(frame.counted() for frame in evaluated)
                thresholds = sampled([s for frame in evaluated for s in frame.scores()], objects)
                precision, similarity = [], []
                for threshold in thresholds:
                    counts = [frame.count(threshold) for frame in evaluated]
                    right, wrong, alike = (sum(column) for column in zip(*counts, strict=True))
                    precision.append(right / (right + wrong) if right + wrong else 0.0)
                    similarity.append(alike / (right + wrong) if right + wrong else 0.0)
                scores[kind][metric][level] = averages(precision)
                if metric == '2d':
                    scores[kind]['aos'][level] = averages(similarity)
    return scores
