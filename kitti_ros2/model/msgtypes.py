# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The names of ROS message types, in ROS 2's spelling."""

ANNOTATIONS = 'foxglove_msgs/msg/ImageAnnotations'
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
CLOCK = 'rosgraph_msgs/msg/Clock'
CLOUD = 'sensor_msgs/msg/PointCloud2'
COMPRESSED = 'sensor_msgs/msg/CompressedImage'
DETECTIONS_2D = 'vision_msgs/msg/Detection2DArray'
DETECTIONS_3D = 'vision_msgs/msg/Detection3DArray'
DETECTED_OBJECTS = 'autoware_perception_msgs/msg/DetectedObjects'
DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
FIX = 'sensor_msgs/msg/NavSatFix'
HEADER = 'std_msgs/msg/Header'
IMAGE = 'sensor_msgs/msg/Image'
IMU = 'sensor_msgs/msg/Imu'
LASER_SCAN = 'sensor_msgs/msg/LaserScan'
LIVOX = frozenset({'livox_ros_driver/msg/CustomMsg', 'livox_ros_driver2/msg/CustomMsg'})
"""Clouds of Livox' drivers."""
MARKERS = 'visualization_msgs/msg/MarkerArray'
ODOMETRY = 'nav_msgs/msg/Odometry'
PATH = 'nav_msgs/msg/Path'
POSE = 'geometry_msgs/msg/PoseStamped'
STRING = 'std_msgs/msg/String'
TF = 'tf2_msgs/msg/TFMessage'
TF_TYPES = frozenset({TF, 'tf/msg/tfMessage'})
"""Types of dynamic and static transforms, also of ROS 1's first tf."""
TRACKED_OBJECTS = 'autoware_perception_msgs/msg/TrackedObjects'
TWIST = 'geometry_msgs/msg/TwistStamped'
TWIST_COVARIANCE = 'geometry_msgs/msg/TwistWithCovarianceStamped'
VELODYNE = 'velodyne_msgs/msg/VelodyneScan'
