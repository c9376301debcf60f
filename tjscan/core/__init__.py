"""What every other room uses: errors, frames, files, configuration."""
