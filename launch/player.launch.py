# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Play a KITTI recording or a bag live: source:=PATH; rviz:=true shows it in RViz."""

from __future__ import annotations

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

SHARE = FindPackageShare('kitti_ros2')

# Name, description and type, which are those of the node's parameter of the same name.
ARGUMENTS = (
    ('source', 'KITTI folder or bag', str),
    ('sequence', 'drive, split or sequence of the source', str),
    ('imu_from', 'unsynchronised drive with 100 Hz packets', str),
    ('rate', 'speed; 1.0 is the recorded one', float),
    ('loop', 'number of rounds; 0 is endless', int),
    ('start_paused', 'wait for a resume', bool),
    ('clock', '/clock messages per second; 0 is none', float),
)


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, start the player and, if requested, RViz."""
    declared = [
        DeclareLaunchArgument(
            name, default_value='', description=f'{description}; empty takes that of params_file'
        )
        for name, description, _ in ARGUMENTS
    ]
    declared += [
        DeclareLaunchArgument(
            'params_file',
            default_value=PathJoinSubstitution([SHARE, 'config', 'player.yaml']),
            description='file of all parameters; given arguments win over it',
        ),
        DeclareLaunchArgument('rviz', default_value='false', description='whether to start RViz'),
        DeclareLaunchArgument(
            'rviz_config',
            default_value='kitti.rviz',
            description='what RViz shows, of config/: kitti.rviz, or kitti360.rviz for KITTI-360',
        ),
    ]
    rviz_config = LaunchConfiguration('rviz_config')
    rviz = Node(
        package='rviz2',
        executable='rviz2',
        arguments=['-d', PathJoinSubstitution([SHARE, 'config', rviz_config])],
        parameters=[{'use_sim_time': True}],
        condition=IfCondition(LaunchConfiguration('rviz')),
    )
    return LaunchDescription([*declared, OpaqueFunction(function=start_player), rviz])


def start_player(context: LaunchContext) -> list[Node]:
    """Start the player; the parameter of an argument that is not given comes from params_file."""
    words = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    given = {
        name: ParameterValue(words[name], value_type=kind)
        for name, _, kind in ARGUMENTS
        if words[name]
    }
    player = Node(
        package='kitti_ros2',
        executable='player',
        name='kitti_player',
        parameters=[LaunchConfiguration('params_file'), *([given] if given else [])],
        output='screen',
    )
    return [player]
