# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The classes of other data sets and detectors become KITTI's, by a plan that lists them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import named_boxes as robots
import pytest

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.plan import format_plan, parse_plan
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.classes import kitti_class
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.options.read import ReadOptions

FAMILIES = {
    'KITTI': {name: name for name in ('Car', 'Van', 'Truck', 'Pedestrian', 'Cyclist', 'Tram')},
    'KITTI in capitals': {'PEDESTRIAN': 'Pedestrian', 'PERSON_SITTING': 'Person_sitting'},
    'nuScenes': {
        'vehicle.car': 'Car',
        'vehicle.truck': 'Truck',
        'vehicle.bicycle': 'Cyclist',
        'human.pedestrian.adult': 'Pedestrian',
        'human.pedestrian.construction_worker': 'Pedestrian',
        'vehicle.bus.rigid': 'Misc',
        'movable_object.trafficcone': 'Misc',
    },
    'Argoverse 2': {
        'REGULAR_VEHICLE': 'Car',
        'BOX_TRUCK': 'Truck',
        'BICYCLIST': 'Cyclist',
        'PEDESTRIAN': 'Pedestrian',
        'BOLLARD': 'Misc',
    },
    'Waymo': {
        'TYPE_VEHICLE': 'Car',
        'TYPE_PEDESTRIAN': 'Pedestrian',
        'TYPE_CYCLIST': 'Cyclist',
        'TYPE_SIGN': 'Misc',
    },
    'COCO': {'person': 'Pedestrian', 'bicycle': 'Cyclist', 'car': 'Car', 'train': 'Tram'},
    'Autoware': {'CAR': 'Car', 'PEDESTRIAN': 'Pedestrian', 'BICYCLE': 'Cyclist', 'BUS': 'Misc'},
    'warehouse': {'person': 'Pedestrian', 'forklift': 'Misc', 'pallet': 'Misc'},
    'numbers': {'1': 'Misc', '7': 'Misc'},
}


def converted(bag, out, change=lambda plan: plan, layout=Layout.OBJECT):
    options = ImportOptions(layout=layout)
    survey = survey_bags([bag])
    guessed = guess([bag], survey, options)
    plan = change(parse_plan(format_plan(guessed.plan, guessed.notes), Path('plan.yaml')))
    assert plan == change(guessed.plan)
    report = convert_by_plan([bag], plan, survey, out, options)
    return guessed, report, open_recording(out, ReadOptions(layout=layout))


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.TRACKING])
def test_boxes_of_one_id_are_all_written(layout, tmp_path):
    bag = robots.write(tmp_path / 'bag', ['car', 'car', 'person'], identity='0')
    _, report, recording = converted(bag, tmp_path / 'out', layout=layout)
    stream = recording.streams[Stream.LABELS]
    labels = [recording.read(Stream.LABELS, int(number)) for number in stream.numbers]
    count = report.counts['labels']
    assert sorted(len(label.boxes or label.cuboids) for label in labels) == [2] * (count - 1) + [3]
    assert all(len({box.track_id for box in label.boxes}) == len(label.boxes) for label in labels)
    assert f'{count + 1} boxes have the id of another one of their message' in ' '.join(
        report.notes
    )


def classes(recording):
    """By place of the box in its message."""
    number = int(recording.streams[Stream.LABELS].numbers[-1])
    boxes = recording.read(Stream.LABELS, number).boxes
    return {round((box.size_hwl[1] - 1) * 100): box.class_name for box in boxes}


@pytest.mark.one_in(3)
@pytest.mark.parametrize('family', FAMILIES)
def test_names_of_a_family_become_those_of_kitti(family, tmp_path):
    names = FAMILIES[family]
    bag = robots.write(tmp_path / 'bag', list(names))
    found, report, recording = converted(bag, tmp_path / 'out')
    assert classes(recording) == dict(enumerate(names.values()))
    listed = {name: kind for name, kind in names.items() if name != kind}
    assert found.plan.labels.classes == listed
    others = [name for name, kind in names.items() if kind == 'Misc']
    told = ' '.join(note for note in report.notes if 'were written as Misc' in note)
    assert all(f'{name} ({count})' in told for name, count in counts(names, others).items())
    assert bool(told) == bool(others)


def counts(names, some):
    last = list(names)[-1]
    return {name: 1 if name == last else 20 for name in some}


def with_labels(**changes):
    return lambda plan: replace(plan, labels=replace(plan.labels, **changes))


def test_custom_classes_are_kept_on_request(tmp_path):
    bag = robots.write(tmp_path / 'bag', ['person', 'fork lift', 'pallet', 'unknown'])
    change = with_labels(keep_classes=True)
    _, report, recording = converted(bag, tmp_path / 'out', change)
    assert list(classes(recording).values()) == ['Pedestrian', 'fork_lift', 'pallet', 'Misc']
    assert not any('as Misc' in note for note in report.notes)


def test_the_plan_maps_names_in_any_case_and_numbers(tmp_path):
    bag = robots.write(tmp_path / 'bag', ['1', 'Fork-Lift', 'car', 'cart'])
    given = {'1': 'Pedestrian', 'fork_lift': 'Truck', 'CAR': 'Van', 'cart': 'DontCare'}
    _, _, recording = converted(bag, tmp_path / 'out', with_labels(classes=given))
    text = (tmp_path / 'out' / 'training' / 'label_2' / '000019.txt').read_text()
    lines = [line.split() for line in text.splitlines()]
    assert [line[0] for line in lines] == ['Pedestrian', 'Truck', 'Van', 'DontCare']
    assert lines[3][1:4] == ['-1.00', '-1', '-10.00'] or float(lines[3][3]) == -10
    assert [float(word) for word in lines[3][8:]] == [-1, -1, -1, -1000, -1000, -1000, -10]
    assert len(recording.read(Stream.LABELS, 19).boxes) == 4


PLAN = (
    'layout: object\nname: training\nreference: scan\ntolerance_s: 0.05\n'
    'labels: {topic: /boxes, %s}\n'
)


@pytest.mark.parametrize(
    ('labels', 'said'),
    [
        ('classes: {CAR: Kar}', "labels: classes: CAR: 'Kar'; expected Car, Van,"),
        ('classes: {CAR: Kar}', 'did you mean Car?'),
        ('classes: [Car]', "labels: classes: ['Car']; expected NAME: CLASS"),
        ('classes: {1: 2}', 'labels: classes: 1: 2; expected two texts'),
        ('classes: {a: b c}, keep_classes: true', "labels: classes: a: 'b c'; expected"),
        ('keep_classes: some', "labels: keep_classes: 'some'; expected true or false"),
        ('offset_s: .nan', 'labels: offset_s: nan; expected a finite number'),
    ],
)
def test_classes_that_cannot_be_meant_are_refused_by_name(labels, said):
    with pytest.raises(UsageError) as caught:
        parse_plan(PLAN % labels, Path('plan.yaml'))
    assert str(caught.value).startswith('plan.yaml: ')
    assert said in str(caught.value)


def test_numbers_may_be_keys_and_classes_have_kittis_spelling():
    plan = parse_plan(PLAN % 'classes: {1: car, b: person sitting}', Path('plan.yaml'))
    assert plan.labels.classes == {'1': 'Car', 'b': 'Person_sitting'}


@pytest.mark.parametrize('name', ['', '   ', '...', 'type_', 'vehicle.', '\u4eba'])
def test_any_name_has_a_class_or_none(name):
    assert kitti_class(name) in {None, 'Car'}
