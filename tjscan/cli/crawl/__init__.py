"""The commands of ``tjscan crawl``."""
