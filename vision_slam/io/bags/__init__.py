"""ROS 1 and ROS 2 bags as recordings: choice of topics, decoding of messages, order of their times.

Point clouds in bags are read by `survey.interchange`.
"""
