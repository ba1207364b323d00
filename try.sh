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
  sudo=$(command -v sudo) || sudo=
  $sudo apt-get -qq update
  $sudo apt-get -qq install -y python3-venv >/dev/null
fi
python3 -m venv "$here/.venv"
"$here/.venv/bin/pip" install -q "$here"
"$here/.venv/bin/kitti-ros2" demo --overwrite
printf '\nActivate the environment first: . %q\n' "$here/.venv/bin/activate"
