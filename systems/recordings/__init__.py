"""Reads recordings of real robots: ROS 1 and ROS 2 bags, MCAP, and files of the RBO data set."""
