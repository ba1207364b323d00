# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
#
# kitti_ros2 in a workspace of ROS 2; its steps are those of README.md.
#
#   docker build -t kitti_ros2 .   # Jazzy; --build-arg ROS_DISTRO=kilted takes another
#   docker run --rm -it --network host -v "$PWD:/data" -w /data kitti_ros2 \
#     ros2 run kitti_ros2 kitti-ros2 info 2011_09_26/2011_09_26_drive_0005_sync
ARG ROS_DISTRO=jazzy
FROM ros:${ROS_DISTRO}

ENV PIP_NO_CACHE_DIR=1 PIP_ROOT_USER_ACTION=ignore
WORKDIR /root/ros2_ws
COPY . src/kitti_ros2

# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends python3-pip \
    && rosdep update --rosdistro "$ROS_DISTRO" \
    && PIP_BREAK_SYSTEM_PACKAGES=1 rosdep install --from-paths src --ignore-src -y \
    && python3 -m pip install --user --break-system-packages 'isal>=1.7,<2' 'lz4>=4.3,<5' 'mcap>=1.3,<2' 'zstandard>=0.22,<0.26' \
    && rm -rf /var/lib/apt/lists/*

RUN . "/opt/ros/$ROS_DISTRO/setup.sh" \
    && colcon build --packages-select kitti_ros2

ENTRYPOINT ["bash", "-c", ". /root/ros2_ws/install/setup.bash && exec \"$@\"", "kitti_ros2"]
CMD ["ros2", "run", "kitti_ros2", "kitti-ros2", "--help"]
