"""Movable objects: configuration, models, poses, contacts, disturbances."""
