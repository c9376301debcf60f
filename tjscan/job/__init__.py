"""The job files: what is to be done, in millimetres and degrees, as a person writes it."""
