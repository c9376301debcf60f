"""The page that shows a run in a browser, while it goes on or from its recording.

It knows no algorithm: each registers what is shown of it (`TaskPlugin.live`), as steps of plain
data. It listens and is never waited for.
"""
