#!/usr/bin/env bash
# catkin_prepare_release: a setup.py that reads its version from package.xml stops a release half done.
#
# Version: catkin_pkg 1.1.1.
#
# Behaviour: for a package of build type ament_python, catkin_prepare_release wants the version as a
# literal in setup.py (version='1.2.3',). Where setup.py reads it from package.xml, so that it stands
# in one place, the command ends with exit code 1. But "Forthcoming" in
# CHANGELOG.rst has been renamed to the new version and the day by then; package.xml is as it was.
#
# Why it surprises: the command checks first that the working copy is clean and that every changelog
# has a section to rename, and package.xml, the version that ROS goes by, it could have changed. One
# expects it to leave setup.py alone or to refuse before it writes. A second run, after setup.py has
# been mended, is refused: the working copy is not clean, and no "Forthcoming" is left to rename.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
export GIT_CONFIG_GLOBAL=/dev/null GIT_AUTHOR_NAME=a GIT_AUTHOR_EMAIL=a@b GIT_COMMITTER_NAME=a GIT_COMMITTER_EMAIL=a@b
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet 'catkin_pkg==1.1.1'

mkdir "$folder/own" && cd "$folder/own"
cat >package.xml <<'XML'
<package format="3">
  <name>own</name>
  <version>0.1.0</version>
  <description>Own.</description>
  <maintainer email="a@b.org">a</maintainer>
  <license>Apache-2.0</license>
  <export><build_type>ament_python</build_type></export>
</package>
XML
cat >setup.py <<'PYTHON'
from xml.etree import ElementTree

from setuptools import setup

setup(name='own', version=ElementTree.parse('package.xml').findtext('version'))
PYTHON
printf '%s\n' '^^^^^^^^^^^^^^^^^^^^^^^^^' 'Changelog for package own' '^^^^^^^^^^^^^^^^^^^^^^^^^' '' \
  'Forthcoming' '-----------' '* First.' >CHANGELOG.rst
git init -q . && git add . && git commit -qm 'First'
git clone -q --bare . ../remote.git && git remote add origin ../remote.git
git push -q -u origin HEAD

release() {
  "$folder/venv/bin/catkin_prepare_release" --version 0.2.0 --no-push -y 2>&1 || echo "exit code $?"
}
release | tee "$folder/first"
git status --short
mended=$(sed "s/version=.*findtext('version')/version='0.1.0',/" setup.py)
echo "$mended" >setup.py
git commit -q -m 'A literal' setup.py && git push -q
release | tee "$folder/second"

grep -q 'exit code 1' "$folder/first"
grep -q "Failed to find a normal version statement" "$folder/first"
grep -q '^0.2.0 (' CHANGELOG.rst
grep -q '<version>0.1.0<' package.xml
grep -q 'exit code 1' "$folder/second"
