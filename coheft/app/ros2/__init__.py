"""Runs seen from ROS 2, and robots driven from there, without any ROS installed here: see docs/ros2.md.

Takes the packages of the extra ``record``: without them the import of any module here but ``names`` raises
``MissingPackageError``.
"""
