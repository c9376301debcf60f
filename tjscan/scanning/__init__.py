"""The stepwise scan: predict, scan, correct, scan, all the way round."""
