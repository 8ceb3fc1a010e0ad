"""The only door between ROS messages and the core: pure, validating converters."""
