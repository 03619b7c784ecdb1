"""Fusion between a camera and whoever takes its detections: ros2 launch fusion_launch.py"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import ExecuteProcess


def generate_launch_description():
    parameters = Path(__file__).with_name("fusion.yaml")
    fusion = ExecuteProcess(
        name="fuseline",
        output="screen",
        cmd=[
            "fuseline-ros2", "--ros-args",
            "--params-file", str(parameters),
            "-r", "input:=/camera/image_raw",
            "-r", "output:=/detections",
        ],
    )
    return LaunchDescription([fusion])
