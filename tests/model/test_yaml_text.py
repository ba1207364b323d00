# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""YAML is parsed alike by libyaml and by PyYAML, whatever the text."""

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.model.yaml_text import load_yaml

TEXT = """\
information:
  version: 9
  names: [a, "b c", null]
  duration: {nanoseconds: 12}
"""


def outcome(load, text):
    try:
        return repr(load(text))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        return type(error), str(error)


@given(st.integers(0, len(TEXT) - 1), st.sampled_from(list('\t:-"\'{[\n%#?|>,]}@`\\~\0é')))
def test_a_damaged_text_has_one_outcome(place, character):
    text = TEXT[:place] + character + TEXT[place + 1 :]
    assert outcome(load_yaml, text) == outcome(yaml.safe_load, text)


@pytest.mark.parametrize('text', [b'\xff\xfe', b'a: \xff', 'a: \ud800', '2001-99-99', '', '- \t1'])
def test_a_hostile_text_has_one_outcome(text):
    assert outcome(load_yaml, text) == outcome(yaml.safe_load, text)


@pytest.mark.parametrize('text', ['[' * 100_000, '- ' * 100_000, '{a: ' * 100_000])
def test_deep_nesting_is_an_error(text):
    with pytest.raises(RecursionError):
        load_yaml(text)
