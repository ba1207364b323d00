# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""YAML is parsed alike by libyaml and by PyYAML, whatever the text, and at a bounded cost."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.model import yaml_text
from kitti_ros2.model.yaml_text import YamlTextError, load_yaml

TEXT = """\
information:
  version: 9
  names: [a, "b c", null]
  duration: {nanoseconds: 12}
"""


def outcome(load, text):
    try:
        return repr(load(text))
    except (yaml.YAMLError, ValueError, RecursionError):
        return 'an error'


def bomb(levels, width, text='x'):
    """A list of lists of ... : as many items as width to the power of levels."""
    lines = [f'a0: &a0 {text}']
    for level in range(1, levels):
        items = ', '.join([f'*a{level - 1}'] * width)
        lines.append(f'a{level}: &a{level} [{items}]')
    return '\n'.join(lines)


@given(st.integers(0, len(TEXT) - 1), st.sampled_from(list('\t:-"\'{[\n%#?|>,]}@`\\~\0é')))
def test_a_damaged_text_has_one_outcome(place, character):
    text = TEXT[:place] + character + TEXT[place + 1 :]
    assert outcome(load_yaml, text) == outcome(yaml.safe_load, text)


@pytest.mark.parametrize('text', [b'\xff\xfe', b'a: \xff', 'a: \ud800', '2001-99-99', '', '- \t1'])
def test_a_hostile_text_has_one_outcome(text):
    assert outcome(load_yaml, text) == outcome(yaml.safe_load, text)


@pytest.mark.parametrize(
    ('text', 'kind'),
    [
        ("a: !!float ''", 'float'),
        ("- 1\n- !!int ''", 'int'),
        ('a: !!bool maybe', 'bool'),
        ('!!timestamp now', 'timestamp'),
    ],
)
def test_a_value_that_does_not_fit_its_tag_is_an_error_with_its_line(text, kind):
    with pytest.raises(YamlTextError, match=f'line [12]: a value that is no {kind}'):
        load_yaml(text)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('[' * 100_000, 'nested too deeply'),
        ('- ' * 100_000, 'nested too deeply'),
        ('{a: ' * 100_000, 'nested too deeply'),
        (bomb(8, 9), 'aliases repeat too much'),
        (bomb(30, 3), 'aliases repeat too much'),
        (bomb(150, 1), 'nested too deeply'),
        ('a: &a {b: *a}', 'refers to what it is in'),
        ('&a [*a]', 'refers to what it is in'),
        ('9' * 5000, '4300'),
        ('9' * 5001, 'a number of too many digits'),
        ('a: 0x' + 'f' * 4000, 'a number of too many digits'),
        ('a: 1' + ':59' * 2600, 'a number of too many digits'),
        ('a: 1' + ':59' * 300 + '.5', 'a number of too many digits'),
        ('2001-99-99', 'month'),
        ('a: 1\nb: 2\na: 3', "line 3: the key 'a' is there twice"),
        ('a: [b', 'line 1'),
        (b'a: \xff', 'invalid start byte'),
    ],
)
def test_what_is_refused_has_a_reason(text, reason, monkeypatch):
    for fast in (True, False):
        if not fast:
            monkeypatch.delattr(yaml, 'CSafeLoader', raising=False)
        yaml_text._loaders.cache_clear()
        with pytest.raises(YamlTextError, match=reason) as found:
            load_yaml(text)
        assert '\n' not in str(found.value)
        assert len(str(found.value)) < 200
    yaml_text._loaders.cache_clear()


@pytest.mark.parametrize('start', ['[', '{a: '])
def test_scanning_stops_where_the_nesting_is_too_deep(start, monkeypatch):
    monkeypatch.delattr(yaml, 'CSafeLoader', raising=False)
    yaml_text._loaders.cache_clear()
    levels = []
    scan = yaml.scanner.Scanner.fetch_flow_collection_start

    def spy(self, kind):
        levels.append(kind)
        scan(self, kind)

    monkeypatch.setattr(yaml.scanner.Scanner, 'fetch_flow_collection_start', spy)
    with pytest.raises(YamlTextError, match='nested too deeply'):
        load_yaml('images: ' + start * 5000)
    assert 0 < len(levels) <= 2 * 100  # the text is parsed twice
    yaml_text._loaders.cache_clear()


def test_aliases_and_merges_of_usual_sizes_are_read():
    text = 'base: &base {depth: 5, keep: [1, 2]}\none: {<<: *base, depth: 6}\ntwo: *base\n'
    assert load_yaml(text) == yaml.safe_load(text)
    many = 'base: &base {depth: 5}\nall: [' + ', '.join(['*base'] * 4000) + ']'
    assert load_yaml(many) == yaml.safe_load(many)


def test_types_may_stay_text():
    text = 'start: 0010\nepoch: 2011-09-26 13:02:25.123456789\nloop: yes\nrate: 1.5'
    found = load_yaml(text, ('int', 'timestamp'))
    assert found == {
        'start': '0010', 'epoch': '2011-09-26 13:02:25.123456789', 'loop': True, 'rate': 1.5,
    }  # fmt: skip
    assert load_yaml(text)['start'] == 8
