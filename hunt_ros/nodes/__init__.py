"""
The ROS 2 nodes: a module is a node, and what they share is in `support`.

rclpy and the message packages are imported here and nowhere else.
"""
