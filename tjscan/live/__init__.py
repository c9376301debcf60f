"""The page that shows a run in a browser, while it goes on or from its recording.

It knows no algorithm: a run turns what it records into steps of plain data. The
page listens and is never waited for.
"""
