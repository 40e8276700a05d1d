"""Sensor records: tables of times and readings, one class per sensor.

Body frame: x forward, y left, z up, origin on the ground between the tracks. World frame:
easting, northing, elevation. Attitudes are roll, pitch (nose down positive) and yaw
(counter-clockwise from east); R = Rz(yaw) Ry(pitch) Rx(roll) takes the body to the world.
"""
