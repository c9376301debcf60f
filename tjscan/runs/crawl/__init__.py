"""A crawl along a joint: run, gone on with, replayed, and what it leaves behind."""
