"""Recordings: rosbag2 folders with MCAP files, written and read."""
