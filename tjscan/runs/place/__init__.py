"""Where a joint may stand before an arm, and from where its whole groove is scanned."""
