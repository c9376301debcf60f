"""A magnetic crawler that follows a joint on a hull and welds it."""
