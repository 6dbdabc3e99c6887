"""Runs published in ROS 2, and robots driven from there, without an installation of ROS: see docs/ros2.md.

Needs the packages of the extra ``record``: without them the import of any module here but ``names`` raises
``MissingPackageError``.
"""
