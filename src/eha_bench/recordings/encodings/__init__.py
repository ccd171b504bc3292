"""From the bytes of messages to columns of numbers: CDR, ROS 1, JSON, Protobuf."""
