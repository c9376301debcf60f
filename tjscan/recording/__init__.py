"""Recordings: MCAP files of timed messages, each on a topic with a stated schema.

Nothing here knows what is recorded: an algorithm makes its topics of its dataclasses. What
is written together is one chunk of the file, so that after a power cut it is there whole or not
at all. Foxglove and rerun open the files as they are.
"""
