# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Databases that compute what a bag's tables store are refused, and cost little."""

import shutil
import sqlite3
import tracemalloc
from contextlib import closing

import pytest
from fuzz.database_inputs import endless

from kitti_ros2.bags.reader import open_messages, summarize_bag
from kitti_ros2.bags.sqlite_reader import GuardedConnection
from kitti_ros2.model.errors import BadBagError

TOPICS = (
    'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,'
    ' offered_qos_profiles TEXT)'
)
MESSAGES = (
    'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)'
)
A_TOPIC = "INSERT INTO topics VALUES (1, '/t', 'std_msgs/msg/String', 'cdr', '')"
A_MESSAGE = "INSERT INTO messages VALUES (1, 1, 1, x'00010000030000006869')"
ENDLESS = 'WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r)'


def make(path, *statements):
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        for statement in statements:
            database.execute(statement)
    return path


@pytest.mark.parametrize(
    ('statements', 'reason'),
    [
        (
            [TOPICS, A_TOPIC, (f'CREATE VIEW messages AS {ENDLESS} SELECT n id, 1 topic_id, n'
             ' timestamp, zeroblob(9) data FROM r')],
            'messages is a view',
        ),
        (
            [MESSAGES, A_MESSAGE, f"CREATE VIEW topics AS {ENDLESS} SELECT n, '/t' || n FROM r"],
            'it has no list of topics',
        ),
        (
            [TOPICS, A_TOPIC, MESSAGES, ('CREATE VIEW Message_Definitions AS SELECT'
             " load_extension('x') topic_type, '' encoding, '' encoded_message_definition")],
            'message_definitions is a view',
        ),
        (
            [TOPICS, A_TOPIC, 'CREATE VIRTUAL TABLE messages USING fts5(id, topic_id, data)'],
            'messages is a virtual table',
        ),
        (
            [TOPICS, A_TOPIC, ('CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER,'
             ' timestamp INTEGER, data BLOB AS (zeroblob(999999999)))'),
             'INSERT INTO messages(id, topic_id, timestamp) VALUES (1, 1, 1)'],
            'messages has columns that are computed',
        ),
    ],
    ids=['messages', 'topics', 'definitions', 'virtual', 'generated'],
)  # fmt: skip
def test_what_computes_is_refused(tmp_path, statements, reason):
    path = make(tmp_path / 'a.db3', *statements)
    try:
        found = ' '.join(summarize_bag(path).problems)
    except BadBagError as error:
        found = str(error)
    assert reason in found


def test_other_tables_and_triggers_do_not_matter(tmp_path):
    path = make(
        tmp_path / 'a.db3', TOPICS, A_TOPIC, MESSAGES, A_MESSAGE,
        f'CREATE VIEW other AS {ENDLESS} SELECT n FROM r',
        'CREATE TRIGGER t AFTER INSERT ON messages BEGIN DELETE FROM messages; END',
    )  # fmt: skip
    summary = summarize_bag(path)
    assert not summary.problems
    assert [topic.count for topic in summary.topics] == [1]


def test_a_query_without_end_is_stopped():
    with closing(sqlite3.connect(':memory:', factory=GuardedConnection)) as connection:
        connection.guard(1000)
        for _ in range(2):
            with pytest.raises(sqlite3.OperationalError, match='interrupted'):
                connection.execute(f'{ENDLESS} SELECT count(*) FROM r').fetchone()
            assert connection.execute('SELECT 1').fetchone() == (1,)


def test_a_tree_that_leads_to_one_page_again_and_again_ends(tmp_path):
    """The cells of an interior page are made to lead to its first child."""
    rows = f"{ENDLESS} INSERT INTO messages SELECT n, 1, n, x'0001' FROM r LIMIT 300000"
    path = make(tmp_path / 'whole.db3', TOPICS, A_TOPIC, MESSAGES, rows)
    damaged = tmp_path / 'a.db3'
    shutil.copy(path, damaged)
    with closing(sqlite3.connect(path)) as database:
        (root,) = database.execute(
            "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        ).fetchone()
        (size,) = database.execute('PRAGMA page_size').fetchone()
    data = bytearray(damaged.read_bytes())
    start = (root - 1) * size
    assert data[start] == 5  # an interior page of a table
    cells = int.from_bytes(data[start + 3 : start + 5], 'big')
    at = [
        start + int.from_bytes(data[start + 12 + 2 * cell : start + 14 + 2 * cell], 'big')
        for cell in range(cells)
    ]
    for cell in at:
        data[cell : cell + 4] = data[at[0] : at[0] + 4]
    damaged.write_bytes(data)
    summary = summarize_bag(damaged)
    assert summary.problems


@pytest.mark.parametrize('size', [70_000, 900_000_000, 2**40])
def test_pages_that_follow_each_other_in_a_circle_cost_nothing(tmp_path, size):
    path = tmp_path / 'a.db3'
    path.write_bytes(endless(size))
    tracemalloc.start()
    with open_messages(path) as messages:
        assert [*messages] == []
        assert any('row 1 cannot be read' in loss for loss in messages.losses)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20_000_000
