"""Objects: models, poses, contacts, disturbances."""
