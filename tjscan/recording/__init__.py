"""The recording of a scan: an MCAP file to which every pose, profile, section and event goes.

Robotics viewers read it as it is. Poses and profiles use the public Foxglove schemas;
coordinates are metres. Nothing is chunked: a record on disk needs none after it to be read.
"""
