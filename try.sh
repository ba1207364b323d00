#!/usr/bin/env bash
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
#
# Installs kitti_ros2 into .venv beside this script, and makes the demo in ./kitti_ros2_demo; both
# are replaced when it runs again. apt-get is used only if Python's venv module is missing.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

if ! python3 -c 'import ensurepip' 2>/dev/null; then
  if ! command -v apt-get >/dev/null; then
    echo 'try.sh: python3 or its venv module is missing: install it, and run this again' >&2
    exit 1
  fi
  echo 'Installing python3-venv with apt-get'
  sudo=$(command -v sudo) || sudo=
  $sudo apt-get -qq update
  $sudo apt-get -qq install -y python3-venv >/dev/null
fi
python3 -m venv "$here/.venv"
echo "Installing kitti_ros2 and its libraries into $here/.venv: 100 MB to download, about a minute"
quiet=-q
if [[ -t 1 ]]; then quiet=--progress-bar=on; fi
"$here/.venv/bin/pip" install --disable-pip-version-check "$quiet" "$here"
echo 'Making a synthetic recording of 20 frames, its bag and a picture: about ten seconds'
"$here/.venv/bin/kitti-ros2" demo --overwrite
