"""ROS bags: format 1, and rosbag2 folders of sqlite3 or MCAP."""
