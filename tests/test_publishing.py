# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The files that a forge, Docker and a newcomer read say the same as package.xml and README.md."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml

REPO = Path(__file__).resolve().parents[1]
VERSION = ET.parse(REPO / 'package.xml').getroot().findtext('version')
WORKFLOWS = sorted((REPO / '.github/workflows').glob('*.yml'))
PYTHONS = ['3.10', '3.11', '3.12', '3.13']


def parsed(path: Path):
    return yaml.safe_load(path.read_text(encoding='utf-8'))


def steps(path: Path):
    return [step for job in parsed(path)['jobs'].values() for step in job.get('steps', [])]


def matrices(path: Path):
    jobs = parsed(path)['jobs'].values()
    return [job['strategy']['matrix']['python'] for job in jobs if 'strategy' in job]


@pytest.mark.parametrize('path', WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_run_on_every_python(path):
    assert matrices(path) == [PYTHONS]


def test_workflows_run_what_readme_and_ci_say():
    ci = [step.get('run', '') for step in steps(REPO / '.github/workflows/ci.yml')]
    assert 'bash -c "$(.ci/run --command 1)"' in ci
    assert 'bash -c "$(.ci/run --command 2)"' in ci
    assert '.ci/run' in ci
    assert 'mkdocs build --strict' in ci


def test_only_publishing_may_write_and_without_a_password():
    workflow = parsed(REPO / '.github/workflows/release.yml')
    assert workflow['permissions'] == {'contents': 'read'}
    granted = {name: job.get('permissions', {}) for name, job in workflow['jobs'].items()}
    assert {name: may for name, may in granted.items() if may} == {
        'publish': {'id-token': 'write'},
        'release': {'contents': 'write'},
        'pages': {'id-token': 'write', 'pages': 'write'},
    }
    assert set(workflow['jobs']['publish']['needs']) == {'ci', 'try'}
    assert all('secrets.' not in path.read_text(encoding='utf-8') for path in WORKFLOWS)


def test_pixi_has_the_ros_packages_and_the_commands_of_the_others():
    tomllib = pytest.importorskip('tomllib', reason='Python 3.11 reads TOML')
    pixi = tomllib.loads((REPO / 'pixi.toml').read_text(encoding='utf-8'))
    features = pixi['feature']
    needed = ET.parse(REPO / 'package.xml').getroot().iterfind('exec_depend')
    ours = {e.text.replace('_', '-') for e in needed if not e.text.startswith('python3-')}
    named = {name.removeprefix('ros-jazzy-') for name in features['ros']['dependencies']}
    assert named == {*ours, 'rviz2'}
    readme = (REPO / 'README.md').read_text(encoding='utf-8')
    assert f'.venv/bin/{features["test"]["tasks"]["test"]}\n' in readme
    assert features['demo']['tasks']['demo'] in INSTALLED
    # A task of two environments would have to be chosen from.
    assert pixi['environments'] == {
        'default': ['package', 'demo'], 'test': ['test'], 'ros': ['package', 'ros']
    }  # fmt: skip
    extras = features['test']['pypi-dependencies']['kitti_ros2']['extras']
    assert f'.[{",".join(extras)}]' in readme


def test_this_version_has_release_notes():
    notes = (REPO / f'.github/releases/{VERSION}.md').read_text(encoding='utf-8')
    readme = (REPO / 'README.md').read_text(encoding='utf-8')
    commands = re.findall(r'^(?:uvx|pip) .*$', notes, re.MULTILINE)
    assert len(commands) == 2
    assert all(command in readme for command in commands)


def test_image_is_built_by_the_steps_of_the_readme():
    readme = (REPO / 'README.md').read_text(encoding='utf-8')
    section = readme.split('## In a ROS 2 workspace')[1].split('\n## ')[0]
    lines = ''.join(re.findall(r'^```sh\n(.*?)^```$', section, re.MULTILINE | re.DOTALL))
    wanted = re.findall(r'^(?:PIP_\S+ )?(?:rosdep|colcon|python3 -m pip) .*$', lines, re.MULTILINE)
    assert len(wanted) == 3
    image = (REPO / 'Dockerfile').read_text(encoding='utf-8')
    run = re.findall(r'^(?:RUN|    &&) (.*?)(?: \\)?$', image, re.MULTILINE)
    assert [line for line in run if line in wanted] == [wanted[0], wanted[2], wanted[1]]
    assert '\nARG ROS_DISTRO=jazzy\nFROM ros:${ROS_DISTRO}\n' in image


def test_citation_is_of_this_version_and_of_kittis_papers():
    citation = parsed(REPO / 'CITATION.cff')
    assert citation['version'] == VERSION
    assert citation['license'] == 'Apache-2.0'
    first = [
        f'{each["authors"][0]["family-names"]} {each["year"]}' for each in citation['references']
    ]
    assert first == ['Geiger 2012', 'Geiger 2013', 'Behley 2019']


@pytest.mark.parametrize('name', ['bug', 'feature'])
def test_issue_forms_ask(name):
    form = parsed(REPO / f'.github/ISSUE_TEMPLATE/{name}.yml')
    assert form['name'].lower() == name
    ids = [field['id'] for field in form['body']]
    assert len(ids) == len(set(ids)) >= 3
    assert form['body'][0]['validations'] == {'required': True}


STANDIN = """#!/bin/sh
echo "$(basename "$0") $*" >> "$CALLS"
case "$(basename "$0") $*" in
  'python3 -c import ensurepip') exit "$WITHOUT_VENV" ;;
  'python3 -m venv '*) mkdir -p "$3/bin" && cp "$0" "$3/bin/pip" && cp "$0" "$3/bin/kitti-ros2" ;;
esac
"""


@pytest.fixture
def try_it(tmp_path):
    """Run try.sh in a clone, from another folder, with stand-ins for the programs it calls."""
    clone, programs, elsewhere = (tmp_path / name for name in ('a clone', 'programs', 'elsewhere'))
    for folder in (clone, programs, elsewhere):
        folder.mkdir()
    (clone / 'try.sh').write_bytes((REPO / 'try.sh').read_bytes())
    for name in ('basename', 'bash', 'cat', 'cp', 'dirname', 'mkdir'):
        (programs / name).symlink_to(
            next(p for p in (Path('/bin', name), Path('/usr/bin', name)) if p.exists())
        )

    def run(*names: str, without_venv: bool):
        for name in names:
            (programs / name).write_text(STANDIN)
            (programs / name).chmod(0o755)
        calls = tmp_path / 'calls'
        done = subprocess.run(
            ['/bin/bash', str(clone / 'try.sh')],
            cwd=elsewhere,
            capture_output=True,
            text=True,
            check=False,
            env={'PATH': str(programs), 'CALLS': str(calls), 'WITHOUT_VENV': f'{without_venv:d}'},
        )
        said = calls.read_text() if calls.exists() else ''
        return done, said.replace(str(clone), 'CLONE').splitlines()

    return run


INSTALLED = [
    'python3 -m venv CLONE/.venv',
    'pip install --disable-pip-version-check -q CLONE',
    'kitti-ros2 demo --overwrite',
]


def test_try_installs_and_runs_the_demo_again_and_again(try_it):
    for times in (1, 2):
        done, calls = try_it('python3', 'apt-get', 'sudo', without_venv=False)
        assert done.returncode == 0, done.stderr
        assert calls == ['python3 -c import ensurepip', *INSTALLED] * times
        assert [line.split()[0] for line in done.stdout.splitlines()] == ['Installing', 'Making']


@pytest.mark.parametrize('sudo', [True, False])
def test_try_gets_the_venv_module_if_it_is_missing(try_it, sudo):
    done, calls = try_it('python3', 'apt-get', *['sudo'] * sudo, without_venv=True)
    assert done.returncode == 0, done.stderr
    who = 'sudo apt-get' if sudo else 'apt-get'
    assert calls[1:] == [f'{who} -qq update', f'{who} -qq install -y python3-venv', *INSTALLED]


def test_try_without_venv_module_and_apt_get_says_what_to_do(try_it):
    done, calls = try_it('python3', without_venv=True)
    assert done.returncode == 1
    assert calls == ['python3 -c import ensurepip']
    assert done.stderr.count('\n') == 1
    assert 'venv module is missing' in done.stderr


def test_try_is_executable():
    assert os.access(REPO / 'try.sh', os.X_OK)
