# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Play a KITTI recording or a bag live: source:=PATH, and with rviz:=true look at it."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

SHARE = FindPackageShare('kitti_ros2')

# Name, default, description, type; as the node's parameters of the same name.
ARGUMENTS = (
    ('source', None, 'KITTI folder or bag', str),
    ('sequence', '', 'drive, split or sequence of the source', str),
    ('rate', '1.0', 'speed; 1.0 is the recorded one', float),
    ('loop', '1', 'how many times to play; 0 is without end', int),
    ('start_paused', 'false', 'wait for a resume', bool),
    ('clock', '100.0', '/clock messages a second; 0 is none', float),
)


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, start the player and, if asked for, RViz."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, default, description, _ in ARGUMENTS
    ]
    declared += [
        DeclareLaunchArgument(
            'params_file',
            default_value=PathJoinSubstitution([SHARE, 'config', 'player.yaml']),
            description='all other parameters',
        ),
        DeclareLaunchArgument('rviz', default_value='false', description='whether to start RViz'),
    ]
    given = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, _, _, kind in ARGUMENTS
    }
    player = Node(
        package='kitti_ros2',
        executable='player',
        name='kitti_player',
        parameters=[LaunchConfiguration('params_file'), given],
        output='screen',
    )
    rviz = Node(
        package='rviz2',
        executable='rviz2',
        arguments=['-d', PathJoinSubstitution([SHARE, 'config', 'kitti.rviz'])],
        parameters=[{'use_sim_time': True}],
        condition=IfCondition(LaunchConfiguration('rviz')),
    )
    return LaunchDescription([*declared, player, rviz])
