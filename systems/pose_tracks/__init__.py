"""Joints from recorded poses of any tracker, without a robot, a simulator or Drake."""
