"""What every other room stands on: errors, frames, files, configuration."""
