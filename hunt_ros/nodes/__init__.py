"""The ROS 2 nodes. rclpy and the message packages are imported here and nowhere else."""
