"""Reading and writing of recordings (rosbag2 folders with MCAP files)."""
