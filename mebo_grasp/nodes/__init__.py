"""The ROS 2 side: thin nodes that convert, call and reply."""
