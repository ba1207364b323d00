# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""package.xml, setup.py, README.md and .ci/run say the same, and name everything there is."""

from __future__ import annotations

import ast
import re
import runpy
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import kitti_ros2

REPO = Path(__file__).resolve().parents[1]

# Looked up in rosdistro's rosdep/python.yaml, and among the packages released into Jazzy.
ROSDEP_KEYS = {
    'diagnostic_msgs',
    'geometry_msgs',
    'launch',
    'launch_ros',
    'nav_msgs',
    'rcl_interfaces',
    'python3-httpx',
    'python3-hypothesis',
    'python3-jinja2',
    'python3-matplotlib',
    'python3-numpy',
    'python3-opencv',
    'python3-pil',
    'python3-pytest',
    'python3-pytest-timeout',
    'python3-rich',
    'python3-rosbags-pip',
    'python3-typer',
    'python3-yaml',
    'rclpy',
    'ros2bag',
    'rosbag2_storage_mcap',
    'rosgraph_msgs',
    'sensor_msgs',
    'std_msgs',
    'std_srvs',
    'tf2_msgs',
    'vision_msgs',
    'visualization_msgs',
}

# The rosdep key that brings a requirement of setup.py to a workspace.
KEY_OF = {
    'httpx': 'python3-httpx',
    'jinja2': 'python3-jinja2',
    'numpy': 'python3-numpy',
    'opencv-python-headless': 'python3-opencv',
    'pillow': 'python3-pil',
    'pyyaml': 'python3-yaml',
    'rich': 'python3-rich',
    'rosbags': 'python3-rosbags-pip',
    'typer': 'python3-typer',
}

# Where the name to import differs from the name to install.
INSTALLED_AS = {
    'mcap_protobuf': 'mcap-protobuf-support',
    'PIL': 'pillow',
    'cv2': 'opencv-python-headless',
    'foxglove': 'foxglove-sdk',
    'rerun': 'rerun-sdk',
    'yaml': 'pyyaml',
}

CLI_IS_THERE = (REPO / 'kitti_ros2/cli/to_bag.py').is_file()


@pytest.fixture(scope='module')
def manifest() -> ET.Element:
    return ET.parse(REPO / 'package.xml').getroot()


@pytest.fixture(scope='module')
def setup_arguments() -> dict[str, Any]:
    """Run setup.py with a stand-in for setuptools that only notes what it is given."""
    noted: dict[str, Any] = {}
    standin = ModuleType('setuptools')
    standin.setup = lambda **arguments: noted.update(arguments)  # type: ignore[attr-defined]
    standin.find_packages = lambda **arguments: arguments  # type: ignore[attr-defined]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, 'setuptools', standin)
        runpy.run_path(str(REPO / 'setup.py'))
    return noted


@pytest.fixture(scope='module')
def requirements(setup_arguments: dict[str, Any]) -> dict[str, Requirement]:
    parsed = [Requirement(line) for line in setup_arguments['install_requires']]
    return {canonicalize_name(requirement.name): requirement for requirement in parsed}


def readme_commands() -> list[str]:
    text = (REPO / 'README.md').read_text(encoding='utf-8')
    return re.findall(r'^```bash\n(.*?)^```$', text, re.MULTILINE | re.DOTALL)


class ImportedNames(ast.NodeVisitor):
    """Collects the top-level names that a module imports when it runs."""

    def __init__(self) -> None:
        self.names: set[str] = set()

    def visit_Import(self, node: ast.Import) -> None:
        self.names |= {alias.name.split('.')[0] for alias in node.names}

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        if node.module and not node.level:
            self.names.add(node.module.split('.')[0])

    def visit_If(self, node: ast.If) -> None:
        if ast.unparse(node.test) != 'TYPE_CHECKING':
            self.generic_visit(node)


def installed_names() -> set[str]:
    """Name, as one would install them, the packages from outside that the package imports."""
    collector = ImportedNames()
    for path in (REPO / 'kitti_ros2').rglob('*.py'):
        collector.visit(ast.parse(path.read_text(encoding='utf-8')))
    outside = collector.names - set(sys.stdlib_module_names) - {'kitti_ros2'}
    return {canonicalize_name(INSTALLED_AS.get(name, name)) for name in outside}


def test_package_xml_is_format_3(manifest: ET.Element) -> None:
    assert manifest.tag == 'package'
    assert manifest.get('format') == '3'
    assert manifest.findtext('name') == 'kitti_ros2'
    assert re.fullmatch(r'\d+\.\d+\.\d+', manifest.findtext('version', ''))
    assert manifest.findtext('license') == 'Apache-2.0'
    assert manifest.findtext('export/build_type') == 'ament_python'
    maintainer = manifest.find('maintainer')
    assert maintainer is not None
    assert maintainer.text
    assert '@' in maintainer.get('email', '')


def test_rosdep_keys_are_real_and_sorted_into_kinds(manifest: ET.Element) -> None:
    keys = [element.text for element in manifest if element.tag.endswith('_depend')]
    assert len(keys) == len(set(keys))
    assert set(keys) == ROSDEP_KEYS
    tests = {element.text for element in manifest.iterfind('test_depend')}
    assert tests == {'python3-hypothesis', 'python3-pytest', 'python3-pytest-timeout'}


def test_workspace_gets_every_requirement(
    manifest: ET.Element, requirements: dict[str, Requirement]
) -> None:
    """By its rosdep key, or by the pip line of README.md with the same bounds as in setup.py."""
    keys = {element.text for element in manifest.iterfind('exec_depend')}
    readme = (REPO / 'README.md').read_text(encoding='utf-8')
    for name, requirement in requirements.items():
        if name in KEY_OF:
            assert KEY_OF[name] in keys
        else:
            bounds = sorted(str(part) for part in requirement.specifier)
            line = re.search(rf"'{name}([^']*)'", readme)
            assert line, f'README.md does not say how a workspace gets {name}'
            assert sorted(line[1].split(',')) == bounds


def test_setup_takes_its_facts_from_package_xml(
    manifest: ET.Element, setup_arguments: dict[str, Any]
) -> None:
    for fact in ('name', 'version', 'description', 'license', 'maintainer'):
        assert setup_arguments[fact] == manifest.findtext(fact)


def test_version_is_the_one_of_package_xml(manifest: ET.Element) -> None:
    version = manifest.findtext('version')
    try:
        assert metadata.version('kitti_ros2') == version, 'another version is installed: reinstall'
    except metadata.PackageNotFoundError:
        pytest.skip('the package is not installed')
    assert kitti_ros2.__version__ == version
    with pytest.raises(AttributeError, match='no attribute'):
        _ = kitti_ros2.no_such_name


def test_index_shows_a_page_of_its_own(setup_arguments: dict[str, Any]) -> None:
    """It has neither the pictures nor the files that README.md leads to."""
    page = setup_arguments['long_description']
    assert page.startswith('# kitti_ros2\n')
    links = re.findall(r'\]\(([^)]*)\)', page)
    assert [link for link in links if not link.startswith('https://')] == []
    text = (REPO / 'README.md').read_text(encoding='utf-8')
    assert re.findall('^## .*$', page, re.MULTILINE) == re.findall('^## .*$', text, re.MULTILINE)


def test_classifiers_name_every_python(setup_arguments: dict[str, Any]) -> None:
    named = re.findall(r'Python :: (3\.\d+)', '\n'.join(setup_arguments['classifiers']))
    assert named == ['3.10', '3.11', '3.12', '3.13']


def test_executable_and_python(setup_arguments: dict[str, Any]) -> None:
    scripts = setup_arguments['entry_points']['console_scripts']
    assert scripts == [
        'kitti-ros2 = kitti_ros2.__main__:main',
        'player = kitti_ros2.__main__:player',
    ]
    assert setup_arguments['python_requires'] == '>=3.10'
    data = [
        'py.typed',
        'datasets/*.txt',
        'messages/definitions/*',
        'options/stacks/*.yaml',
        'player/*.xml',
        'report/templates/*',
    ]
    assert setup_arguments['package_data'] == {'kitti_ros2': data}
    package = REPO / 'kitti_ros2'
    installed = {path for pattern in data for path in package.glob(pattern)}
    assert installed == {
        path for path in package.rglob('*') if path.is_file() and path.suffix not in {'.py', '.pyc'}
    }


def test_every_folder_with_modules_is_a_package(setup_arguments: dict[str, Any]) -> None:
    assert setup_arguments['packages'] == {'include': ['kitti_ros2', 'kitti_ros2.*']}
    folders = {path.parent for path in (REPO / 'kitti_ros2').rglob('*.py')}
    assert [str(folder) for folder in folders if not (folder / '__init__.py').is_file()] == []


def test_every_share_file_is_installed(setup_arguments: dict[str, Any]) -> None:
    installed = dict(setup_arguments['data_files'])
    marker = installed['share/ament_index/resource_index/packages']
    assert marker == ['resource/kitti_ros2']
    assert (REPO / marker[0]).read_bytes() == b''
    assert installed['share/kitti_ros2'] == ['package.xml']
    for folder in ('launch', 'config'):
        present = {str(p.relative_to(REPO)) for p in (REPO / folder).rglob('*') if p.is_file()}
        present = {name for name in present if '__pycache__' not in name}
        assert set(installed.get(f'share/kitti_ros2/{folder}', [])) == present
    for path in (REPO / 'launch').glob('*.py'):
        tree = ast.parse(path.read_text(encoding='utf-8'))
        functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert 'generate_launch_description' in functions


def test_scripts_go_where_ros2_run_looks() -> None:
    text = (REPO / 'setup.cfg').read_text(encoding='utf-8')
    assert '[develop]\nscript_dir=$base/lib/kitti_ros2\n' in text
    assert '[install]\ninstall_scripts=$base/lib/kitti_ros2\n' in text


def test_requirements_are_bounded_on_both_sides(setup_arguments: dict[str, Any]) -> None:
    groups = {'': setup_arguments['install_requires'], **setup_arguments['extras_require']}
    extras = {
        'cluster', 'clouds', 'docs', 'eval', 'foxglove', 'notebook', 'plot', 'png', 'remote',
        'rerun', 'ros', 'test', 'video',
    }  # fmt: skip
    assert set(groups) == {'', *extras}
    for lines in groups.values():
        assert lines == sorted(lines)
        for line in lines:
            operators = {part.operator for part in Requirement(line).specifier}
            assert operators == {'>=', '<'}, line


def test_rclpy_never_comes_uninvited(requirements: dict[str, Requirement]) -> None:
    """A wheel of rclpy beside a workspace's own would shadow it."""
    assert not [name for name in requirements if name.startswith('ros-')]


def test_imports_are_declared(
    manifest: ET.Element, requirements: dict[str, Requirement], setup_arguments: dict[str, Any]
) -> None:
    extras = {
        canonicalize_name(Requirement(line).name)
        for extra, lines in setup_arguments['extras_require'].items()
        if extra not in {'docs', 'test'}
        for line in lines
    }
    workspace = {canonicalize_name(e.text or '') for e in manifest.iterfind('exec_depend')}
    workspace.add(canonicalize_name('builtin_interfaces'))  # comes with every message package
    workspace.add('ipython')  # what shows a picture in a notebook is there in one
    assert installed_names() - set(requirements) - extras - workspace == set()


@pytest.mark.skipif(not CLI_IS_THERE, reason='there is no to-bag yet')
def test_requirements_are_needed(requirements: dict[str, Requirement]) -> None:
    assert set(requirements) - installed_names() == set()


def test_readme_is_short_and_its_links_lead_somewhere() -> None:
    text = (REPO / 'README.md').read_text(encoding='utf-8')
    assert text.count('\n') <= 150
    for link in re.findall(r'\]\((?!https?:)([^)#]+)', text):
        assert (REPO / link).is_file(), link


def test_readme_commands_are_single_lines() -> None:
    commands = readme_commands()
    assert len(commands) == 2
    assert [command.count('\n') for command in commands] == [1, 1]
    assert commands[0] == './try.sh\n'
    assert '.[ros,test]' in commands[1]
    assert '.venv/bin/python -m pytest ' in commands[1]


@pytest.mark.parametrize('number', [1, 2])
def test_ci_runs_the_readme_commands(number: int) -> None:
    script = REPO / '.ci/run'
    printed = subprocess.run(
        ['bash', str(script), '--command', str(number)], capture_output=True, text=True, check=True
    )
    assert printed.stdout == readme_commands()[number - 1]
    text = script.read_text(encoding='utf-8')
    assert f'"$(readme_command {number})"' in text


def pinned_tools() -> dict[str, list[str]]:
    """The versions of each program in .ci/tools.txt: one, or one for some versions of Python."""
    found: dict[str, list[str]] = {}
    text = (REPO / '.ci/tools.txt').read_text(encoding='utf-8')
    for entry in re.split(r'\n(?=\w)', text)[1:]:
        name, _, version = entry.split()[0].partition('==')
        assert version, entry
        assert re.search(r'--hash=sha256:[0-9a-f]{64}', entry), name
        found.setdefault(canonicalize_name(name), []).append(version)
    return found


def test_tools_are_pinned_with_hashes_within_their_bounds(
    setup_arguments: dict[str, Any],
) -> None:
    pinned = pinned_tools()
    wanted = (REPO / '.ci/tools.in').read_text(encoding='utf-8').splitlines()
    ours = {Requirement(line).name: line for line in setup_arguments['extras_require']['test']}
    lines = [line for line in wanted if line and not line.startswith('#')]
    assert len(lines) > 5
    for line in (*lines, ours['ruff'], ours['mypy']):
        requirement = Requirement(line)
        versions = pinned[canonicalize_name(requirement.name)]
        assert all(version in requirement.specifier for version in versions), line


def test_ci_installs_its_tools_by_hash_only() -> None:
    script = (REPO / '.ci/run').read_text(encoding='utf-8')
    assert '--require-hashes --only-binary :all: -r .ci/tools.txt' in script
    for name in pinned_tools():
        assert not re.search(rf"pip\W+install\b[^\n]*['\" ]{re.escape(name)}[=<>~'\"]", script), (
            name
        )


def test_every_combination_of_versions_is_listed() -> None:
    listed = subprocess.run(
        ['bash', str(REPO / '.ci/versions'), '--list'], capture_output=True, text=True, check=True
    ).stdout.split()
    pythons = {name.rpartition('-')[2] for name in listed}
    assert pythons == {'3.10', '3.11', '3.12', '3.13', '3.14'}  # the last is not supported yet
    script = (REPO / '.ci/versions').read_text(encoding='utf-8')
    for path in re.findall(r'tests/\w+/\w+\.py', script):
        assert (REPO / path).is_file(), path


def test_every_code_file_has_its_licence_header() -> None:
    header = (
        '# SPDX-FileCopyrightText: The kitti_ros2 authors\n# SPDX-License-Identifier: Apache-2.0\n'
    )
    names = (
        'setup.py', 'setup.cfg', '.dockerignore', 'CITATION.cff', 'Dockerfile', 'pixi.toml',
        'try.sh',
    )  # fmt: skip
    files = [*(REPO / name for name in names), *(REPO / '.ci').iterdir()]
    files += (REPO / '.github').rglob('*.yml')
    for folder in ('kitti_ros2', 'tests', 'launch', 'benchmarks', 'config', 'docs', 'examples'):
        files += [*(REPO / folder).rglob('*.py'), *(REPO / folder).rglob('*.yaml')]
    bare = [str(path) for path in files if header not in path.read_text(encoding='utf-8')[:200]]
    for path in (REPO / 'kitti_ros2/report/templates').iterdir():
        lines = zip(
            header.splitlines(), path.read_text(encoding='utf-8').splitlines(), strict=False
        )
        if not all(written.startswith(f'{{{line}') for line, written in lines):
            bare.append(str(path))
    assert bare == []
