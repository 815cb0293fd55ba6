"""Estimates and images as ROS 2 messages, for viewers such as Foxglove, Rerun and RViz."""
