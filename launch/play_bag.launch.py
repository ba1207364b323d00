# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Play a bag made by `kitti-ros2 to-bag`, with its time on /clock."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the player; the launch ends at the end of the bag."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('bag', description='rosbag2 folder, or a single .mcap file'),
            DeclareLaunchArgument(
                'rate', default_value='1.0', description='speed; 1.0 is the recorded one'
            ),
            DeclareLaunchArgument(
                'clock', default_value='100.0', description='rate of /clock, in Hz'
            ),
            ExecuteProcess(
                cmd=[
                    'ros2',
                    'bag',
                    'play',
                    LaunchConfiguration('bag'),
                    '--rate',
                    LaunchConfiguration('rate'),
                    '--clock',
                    LaunchConfiguration('clock'),
                ],
                output='screen',
            ),
        ]
    )
