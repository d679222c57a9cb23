"""Cameras: rendering through a lens, exposure, the image sensor."""
