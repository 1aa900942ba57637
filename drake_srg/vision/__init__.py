"""Object localisation from camera images."""
